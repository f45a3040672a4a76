"""Values and intervals from all data, once it is decided which model it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from pacnerf_lpo.diagnosis import comparison
from pacnerf_lpo.diagnosis.comparison import Comparison, compare, estimate, intervals, standardised
from pacnerf_lpo.diagnosis.posterior import of_equal_weights
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm.effects import LinearDrag
from tests.diagnosis import falling

pytestmark = pytest.mark.slow

DRAG, MODEL = 2.0, (LinearDrag(1.5),)
RECORDINGS = 8


def fitted(problem: falling.Falling) -> tuple[Comparison, Comparison]:
    """With drag, to the data that are not held out and to all."""
    part = compare(problem, MODEL, {**problem.first_guess, "drag": 1.5}, (12, 1), False, lambda _: None)
    return part, estimate(problem, MODEL, part, lambda _: None)


def widths(problem: falling.Falling, found: Comparison) -> dict[str, float]:
    return {one.name: one.high - one.low for one in intervals(problem, MODEL, found)[0]}


def test_intervals_from_all_data_are_narrower_and_cover(monkeypatch, small_threads):
    """Of eight recordings at least six, as 96 of 100 such sets do that have intervals of 90 %."""
    falling.install(monkeypatch)
    inside, shares = 0, []
    for seed in range(RECORDINGS):
        problem = falling.Falling({"drag": DRAG}, seed=seed)
        part, whole = fitted(problem)
        (drag,) = (one for one in intervals(problem, MODEL, whole)[0] if one.name == "drag")
        inside += drag.low < DRAG < drag.high
        shares.append(widths(problem, whole)["drag"] / widths(problem, part)["drag"])
    assert inside >= 6
    assert np.median(shares) < 0.8


def test_where_a_fit_of_equal_weights_is_expected(monkeypatch, small_threads):
    """It knows of no replicates and of no errors of the shape: all but one of a hundred end there, and not all of them
    in the middle.
    """
    falling.install(monkeypatch)
    away = []
    for seed in range(RECORDINGS):
        problem = falling.Falling({"drag": DRAG}, seed=seed)
        _, whole = fitted(problem)
        low, high = of_equal_weights(problem, MODEL, whole)["drag"]
        model = problem.model(MODEL, whole.known)
        plain = least_squares(problem.weighted_residual_of(model), whole.free, bounds=model.bounds, diff_step=0.01).x
        half = (high - low) / 2
        away.append((model.physical(plain)["drag"] - whole.known["drag"]) / half)
    assert np.sum(np.abs(away) < 1) >= RECORDINGS - 1
    assert np.abs(away).max() > 0.2


def test_the_fit_goes_on_from_the_start_that_explains_most(monkeypatch, small_threads):
    """And not from one with which the motion is unstable."""
    falling.install(monkeypatch, lambda model, free: free[model.names.index("drag")] > 5.0)
    problem, starts, fits = falling.Falling({"drag": DRAG}), [], []

    def told(problem, model, free, *more, **options):
        starts.append(model.physical(free)["drag"])
        found = standardised(problem, model, free, *more, **options)
        fits.append(replace(found, cost=found.cost - 1e6 * (len(starts) == 2)))
        return fits[-1]

    monkeypatch.setattr(comparison, "standardised", told)
    known = {**problem.first_guess, "drag": 1.5}
    others = [{**known, "drag": drag} for drag in (2.5, 6.0)]
    compare(problem, MODEL, known, (6, 1), False, lambda _: None, others)
    assert starts[:3] == pytest.approx([1.5, 2.5, 6.0])
    assert starts[3] == pytest.approx(fits[1].known["drag"])


@pytest.mark.parametrize("explained", [True, False])
def test_where_nothing_is_explained_the_whole_space_is_searched(monkeypatch, small_threads, explained):
    falling.install(monkeypatch)
    problem, starts, said = falling.Falling({"drag": DRAG}), [], list[str]()

    def told(problem, model, free, *more, **options):
        starts.append(model.physical(free)["drag"])
        found = standardised(problem, model, free, *more, **options)
        return replace(found, cost=found.cost + 1e6 * (not explained and len(starts) == 1))

    monkeypatch.setattr(comparison, "standardised", told)
    found = compare(problem, MODEL, {**problem.first_guess, "drag": 0.5}, (6, 1), False, said.append)
    assert starts[0] == pytest.approx(0.5)
    assert any("searching the whole parameter space" in line for line in said) != explained
    assert explained or starts[1] == pytest.approx(DRAG, rel=0.2)
    assert found.known["drag"] == pytest.approx(DRAG, rel=0.2)


def test_a_search_that_ends_in_unstable_motions_takes_nothing_away(monkeypatch, small_threads):
    falling.install(monkeypatch)
    problem, said = falling.Falling({"drag": DRAG}), list[str]()
    settings = problem, MODEL, {**problem.first_guess, "drag": 1.5}, (6, 1), False, said.append
    expected = compare(*settings)

    def unstable(*_, **__):
        raise SimulationError(0, 0, "unstable from every start")

    monkeypatch.setattr(comparison, "EXPLAINED", 0.0)
    monkeypatch.setattr(comparison, "base_fit", unstable)
    assert compare(*settings).known == expected.known
    assert any("searching the whole parameter space" in line for line in said)


def test_held_out_data_of_another_motion_widen_the_intervals(monkeypatch, small_threads):
    """What the model does not know of is in the last frames only: the drag ends there."""
    falling.install(monkeypatch)
    problem, other = (falling.Falling({"drag": drag}) for drag in (2 * DRAG, 0.0))
    late = np.arange(falling.FRAMES) >= falling.FRAMES - 2
    problem.measured[:, late] = other.measured[:, late]
    part, whole = fitted(problem)
    assert part.dispersion == 1.0 and whole.dispersion > 4.0
    as_noise_says = widths(problem, replace(whole, dispersion=1.0))
    assert widths(problem, whole)["drag"] > 1.5 * as_noise_says["drag"]
