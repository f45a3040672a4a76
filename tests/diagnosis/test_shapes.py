"""Values of a fitted model with the shape that explains most."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.comparison import Comparison, compare
from pacnerf_lpo.diagnosis.shapes import with_other_shapes
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.problem import COARSER
from pacnerf_lpo.identification.shape_modes import ShapeModes
from pacnerf_lpo.inference.checks import Check
from pacnerf_lpo.inference.decision import LEVEL
from tests.diagnosis import falling
from tests.diagnosis.falling import FRAMES, SPACING, Falling, install

SIGMA, SHARPER = 0.04, 5
"""How far the surface may be wrong [m], and how much less noise there is in outlines than in other tests."""


class Stretched(Falling):
    """A ball that was reconstructed too long along x, by some standard deviations of such an error."""

    least_shape_error = SIGMA

    def __init__(self, wrong: float):
        self.numbers = np.zeros(0)
        super().__init__({})
        self.true = ShapeModes(super().sample(COARSER * SPACING, 0), SIGMA)
        self.sensor = self.sensor / SHARPER
        self.numbers = wrong * np.eye(self.true.count)[0]

    def sample(self, spacing: float, seed: int) -> Body:
        body = super().sample(spacing, seed)
        return self.true.moved(body, self.numbers) if len(self.numbers) else body

    def wrong_bodies(self, sigma: float) -> list[Body]:
        body = super().sample(COARSER * SPACING, 0)
        return [self.true.moved(body, self.numbers + more) for more in np.eye(self.true.count)]

    def reshaped(self, sigma: float, numbers: np.ndarray, changes: np.ndarray | None = None) -> Stretched:
        found = copy(self)
        found.numbers = self.numbers + numbers
        found.assumed = 0.0 if changes is None else np.nan_to_num(changes) @ numbers
        for name in ("body", "coarse_body"):
            vars(found).pop(name, None)
        return found


@pytest.fixture
def still(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    install(monkeypatch)
    monkeypatch.setattr(falling, "NOISE", falling.NOISE / SHARPER)
    yield


def compared(problem: Falling) -> Comparison:
    return compare(problem, (), problem.first_guess, (6, 1), False, lambda _: None)


@pytest.fixture
def unexplained(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a model leaves is never taken for its noise."""
    check = Check(10.0, np.ones(6), 0.0)
    monkeypatch.setattr(Comparison, "checks", lambda self, problem: (check, check))


def test_a_shape_whose_errors_explain_the_data_stays(still):
    problem = Stretched(2.5)
    before = compared(problem)
    assert before.checks(problem)[0].p_value > LEVEL
    assert with_other_shapes(problem, (), before, lambda _: None) is before


def test_a_wrong_shape_is_taken_away_and_counts_as_an_error_all_the_same(still, unexplained):
    problem, told = Stretched(2.5), list[str]()
    before = compared(problem)
    found = with_other_shapes(problem, (), before, told.append)
    assert len(before.shape) == 0
    assert found.cost < 0.9 * before.cost and found.rollouts > before.rollouts + problem.true.count
    assert any(text.startswith("shape: iteration") for text in told)
    again = problem.reshaped(found.sigma, found.shape, found.shape_errors)
    right, wrong, now = (one.body.positions[:, 0].std() for one in (Falling({}), problem, again))
    assert abs(float(now - right)) < 0.6 * abs(float(wrong - right))
    predicted = again.model((), found.known).predict(found.free)
    np.testing.assert_allclose(again.residual(predicted), found.residual, atol=1e-6)
    np.testing.assert_allclose(again.assumed, np.nan_to_num(found.shape_errors) @ found.shape)
    own = again.residual(predicted) - again.assumed
    assert np.nanmean(own[:, 0] ** 2) < 0.9 * np.nanmean(before.residual[:, 0] ** 2)


def test_what_no_reconstruction_is_wrong_by_does_not_bend_the_shape(still, unexplained):
    """A strong drag would, in flight: the ball lags by pixels."""
    problem = Stretched(0.0)
    late = np.arange(FRAMES)[:, None] ** 2 * np.eye(11)[1]
    problem.measured = problem.measured + late
    before = compared(problem)
    assert with_other_shapes(problem, (), before, lambda _: None) is before
