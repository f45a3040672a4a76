"""Shape, material and motion found together."""

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.reshaping import JointObjective

TRUE, WRONG = np.array([0.4, -0.3]), np.array([2.0, -1.0, 0.5])
ROWS = (2, 9, 11)


class Bent:
    """Residuals that bend where the shape is wrong, of an object that no simulation is needed for."""

    body = SimpleNamespace(positions=[0])

    def __init__(self) -> None:
        random = np.random.default_rng(0)
        self.columns, self.shapes = (random.standard_normal((*ROWS, count)) for count in (2, 3))
        self.numbers = np.zeros(3)

    def reshaped(self, sigma, numbers):
        found = Bent()
        found.numbers = numbers
        return found

    def model(self, effects, known):
        return self

    def predicted(self, free: np.ndarray) -> np.ndarray:
        """Twice as stiff, and the shape counts for twice as much."""
        return self.columns @ free + np.exp(free[0]) * self.shapes @ self.numbers

    def residual_of(self, model, mask):
        right = self.reshaped(0.01, WRONG)
        return lambda free: (right.predicted(TRUE) - self.predicted(free))[mask]


@pytest.fixture
def joint() -> JointObjective:
    noise = SimpleNamespace(whiten=lambda x: 100 * x, whiten_residual=lambda x: 100 * x)
    model = SimpleNamespace(scales=np.full(2, 0.02), bounds=(np.full(2, -5.0), np.full(2, 5.0)))
    objective = SimpleNamespace(mean=np.zeros(2), deviation=np.ones(2), noise=noise, model=model)
    return JointObjective(Bent(), (), {}, objective, np.ones(ROWS, bool), 0.01)  # type: ignore[arg-type]


def test_every_error_of_the_shape_has_a_row_of_its_own(joint):
    rows = joint(np.array([*TRUE, *WRONG]))
    assert len(rows) == np.prod(ROWS) + 2 + 3
    np.testing.assert_allclose(rows[:-5], 0, atol=1e-9)
    np.testing.assert_allclose(rows[-5:], [*TRUE, *WRONG])


def test_a_shape_of_which_nothing_is_left_is_no_answer(joint, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Bent, "body", SimpleNamespace(positions=[]))
    with pytest.raises(SimulationError, match="nothing is left"):
        joint(np.zeros(5))


def test_shape_and_material_are_found_where_a_straight_line_misses_both(joint):
    told: list[int] = []
    bent = joint.problem
    start = np.zeros(2), np.zeros(3)
    jacobian, changes = -bent.columns, bent.shapes
    straight = np.linalg.lstsq(
        np.concatenate((jacobian, -changes), axis=-1).reshape(-1, 5), -joint(np.zeros(5))[:-5] / 100, rcond=None
    )[0]
    ended, begun = joint.fit(*start, jacobian, changes, lambda iteration, cost, free: told.append(len(free)))
    assert np.abs(straight - [*TRUE, *WRONG]).max() > 0.4
    assert begun == pytest.approx(joint(np.zeros(5)) @ joint(np.zeros(5)))
    np.testing.assert_allclose(ended.free, [*TRUE, *WRONG], atol=0.02)
    assert told and set(told) == {2}
