"""Where a refit starts."""

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import refitting
from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.refitting import starts
from pacnerf_lpo.identification.least_squares import Effort
from pacnerf_lpo.mpm.effects import ThermalSoftening


@pytest.mark.parametrize(
    ("coefficient", "expected"),
    [(-0.2, [-0.2]), (0.4, [0.4]), (-4.0, [-0.5, -4.0]), (4.0, [0.5, 4.0]), (-9.0, [-0.5, -6.0])],
)
def test_beyond_its_probe_a_score_is_not_trusted_alone(coefficient, expected):
    softening = Candidate("ThermalSoftening", ThermalSoftening())
    score = SimpleNamespace(alternative=0, coefficient=(coefficient,))
    assert [start["softening"] for start in starts(softening, score)] == pytest.approx(expected)


@pytest.mark.parametrize(("own", "tried"), [(2000.0, 2), (900.0, 1)])
def test_all_starts_are_tried_until_little_more_than_noise_is_left(own, tried, monkeypatch):
    """Whatever another effect has reached: a bad start is no evidence against an effect. 1,000 numbers are fitted."""
    begun = []

    def ends(objective: object, start: float, *_: object) -> SimpleNamespace:
        begun.append(start)
        return SimpleNamespace(rollouts=1, cost_of=lambda rows: own)

    monkeypatch.setattr(refitting, "fit_or_none", ends)
    model = SimpleNamespace(scales=None, bounds=None, unknowns=[])
    objective = SimpleNamespace(rows=None)
    fits = SimpleNamespace(size=1000, without=9000.0, model=model, objective=objective, own=np.ones(1), comparison=None)
    found, _ = refitting._Fits.best(fits, [0.0, 1.0], lambda _: None, 800.0, 2, Effort(3))
    assert len(begun) == tried and found is not None
