"""A fault of one camera must stand out among the cameras."""

from __future__ import annotations

import numpy as np
import pytest
from pacnerf_lpo.diagnosis.statistics.score import Score
from scipy.stats import norm, t

from pacnerf_lpo.diagnosis.screening import beside_their_like

QUIET = (0.5, -0.7, 0.2, 1.1, -0.3, 0.6, 0.4)


def score(name: str, z: float, components: int = 2) -> Score:
    return Score(name, 0, z, (z,) * components, (1.0,) * components, 0.1, 10.0, np.zeros(3))


def cameras(last: float, others: tuple[float, ...] = QUIET) -> list[Score]:
    return [score(f"CameraShift@{view}", z) for view, z in enumerate((*others, last))]


def test_a_score_among_large_ones_counts_in_units_of_their_spread():
    found = beside_their_like([*cameras(9.0, tuple(5 * z for z in QUIET)), score("LinearDrag", 7.0)])
    factor = np.median([*(abs(5 * z) for z in QUIET), 9.0]) / 0.6745
    assert found[-2].z == pytest.approx(9.0 / factor) and found[-2].error == pytest.approx((factor, factor))
    assert found[-1].z == 7.0


@pytest.mark.parametrize("z", [-5.0, 20.0])
def test_a_held_out_camera_is_as_rare_as_students_t_says(z: float):
    """Seven others with two coefficients each: 14 degrees of freedom."""
    fitted, held = beside_their_like(cameras(z)), beside_their_like(cameras(z), held=True)
    assert fitted[-1].z == z
    assert held[-1].z == pytest.approx(np.sign(z) * norm.isf(t.sf(abs(z), 14)))
    assert abs(held[0].z) <= abs(fitted[0].z)


def test_few_cameras_have_no_spread():
    few = cameras(9.0, QUIET[:2])
    assert [s.z for s in beside_their_like(few, held=True)] == [s.z for s in few]
