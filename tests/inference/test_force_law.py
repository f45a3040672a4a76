"""Which law a residual force is."""

from __future__ import annotations

import numpy as np
import pytest

from pacnerf_lpo.inference.force_law import name_force


def fall(rng: np.random.Generator, count: int = 900) -> dict[str, np.ndarray]:
    """A tumbling body on a parabola that touches the ground in the last third."""
    t = np.repeat(np.linspace(0, 1, 30), count // 30)
    spin = np.tile([0.0, 0.0, 4.0], (count, 1))
    velocity = np.stack((1.5 + 0 * t, -9.8 * t, 0.7 - t), axis=1) + 0.3 * rng.standard_normal((count, 3))
    position = np.stack((1.5 * t, 2 - 4.9 * t**2, 0.7 * t - t**2 / 2), axis=1) + 0.1 * rng.standard_normal((count, 3))
    contact = t > 0.66
    velocity[contact, 1] *= -0.3
    return {"velocity": velocity, "position": position, "spin": spin, "contact": contact, "blocks": np.round(29 * t)}


def named(law) -> dict[str, float]:
    return {term.name: term.coefficient for term in law.terms}


def test_the_law_behind_a_residual_force_is_named():
    rng = np.random.default_rng(4)
    samples = fall(rng)
    v, x = samples["velocity"], samples["position"]
    noise = 0.5 * rng.standard_normal(v.shape)
    linear = name_force(-1.5 * v + noise, **samples)
    quadratic = name_force(-0.3 * np.linalg.norm(v, axis=1, keepdims=True) * v + noise, **samples)
    magnus = name_force(0.5 * np.cross(samples["spin"], v) + [0, 0, 3.0] + noise, **samples)
    spring = name_force(-12 * (x - [0.5, 1.0, 0.0]) + noise, **samples)
    assert named(linear) == {"-v": pytest.approx(1.5, rel=0.05)}
    assert named(quadratic) == {"-|v| v": pytest.approx(0.3, rel=0.05)}
    assert named(magnus) == {"spin x v": pytest.approx(0.5, rel=0.05), "1 along z": pytest.approx(3.0, rel=0.05)}
    assert named(spring)["-x"] == pytest.approx(12, rel=0.1) and set(named(spring)) <= {"-x", "1 along x", "1 along y"}
    term = linear.terms[0]
    assert term.low < 1.5 < term.high and term.frequency == 1.0 and linear.explained > 0.9


def test_noise_and_foreign_laws_are_not_named():
    """White noise, and a force periodic in height, which nothing in the library resembles."""
    rng = np.random.default_rng(5)
    samples = fall(rng)
    assert not name_force(rng.standard_normal((900, 3)), **samples).terms
    foreign = name_force(np.sin(40 * samples["position"])[:, [1, 2, 0]], **samples)
    assert foreign.explained < 0.5
