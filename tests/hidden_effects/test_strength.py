"""How strong an effect is, and how much of it no other effect imitates."""

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.mpm.effects import LinearDrag, QuadraticDrag, UniformForce
from validation.hidden_effects import strength
from validation.hidden_effects.outside import Gust
from validation.hidden_effects.setting import Size, draw_setting
from validation.hidden_effects.strength import Ruler, course_of

pytestmark = pytest.mark.slow

TINY = Size(particles=300, views=3, held=1, frames=6, image_size=48)
KNOWN = [Candidate("QuadraticDrag", QuadraticDrag()), Candidate("UniformForce", UniformForce())]


@pytest.fixture(scope="module")
def ruler() -> Ruler:
    setting, true = draw_setting(np.random.default_rng(3), TINY, "NeoHookean")
    return Ruler(setting, true, count=4)


def test_an_effect_is_imitated_by_itself_and_by_its_class_but_not_by_another(ruler):
    drag = LinearDrag(2.0)
    whole = ruler.snr(drag, drag.guess)
    known = [Candidate("LinearDrag", LinearDrag()), *KNOWN]
    left = ruler.imitated(drag, drag.guess, known)
    assert left["LinearDrag"] < 0.02 * whole
    assert left["QuadraticDrag"] < 0.6 * whole
    assert left["QuadraticDrag"] < left["UniformForce"] <= 1.01 * whole


def test_an_effect_outside_the_catalogue_is_as_strong_as_what_no_known_effect_imitates(ruler, monkeypatch):
    monkeypatch.setattr(strength, "whole_catalogue", lambda *_: KNOWN)
    gust = Gust()
    found = ruler.sized_beyond(gust, course_of(gust, np.random.default_rng(0)), 20.0)
    assert found.beyond == pytest.approx(20.0, rel=0.1)  # the search stops within a tenth
    assert found.imitated_by == "UniformForce"  # a push along x, too
    assert found.snr > found.beyond
    assert min(ruler.imitated(gust, found.values, KNOWN).values()) == pytest.approx(found.beyond)
