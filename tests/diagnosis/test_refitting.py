"""Where a refit starts."""

from types import SimpleNamespace

import pytest

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.refitting import starts
from pacnerf_lpo.mpm.effects import ThermalSoftening


@pytest.mark.parametrize(
    ("coefficient", "expected"),
    [(-0.2, [-0.2]), (0.4, [0.4]), (-4.0, [-0.5, -4.0]), (4.0, [0.5, 4.0]), (-9.0, [-0.5, -6.0])],
)
def test_beyond_its_probe_a_score_is_not_trusted_alone(coefficient, expected):
    softening = Candidate("ThermalSoftening", ThermalSoftening())
    score = SimpleNamespace(alternative=0, coefficient=(coefficient,))
    assert [start["softening"] for start in starts(softening, score)] == pytest.approx(expected)
