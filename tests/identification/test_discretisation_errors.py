"""Errors of resolution and of dissipation that every model has."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.identification.shape_errors import LARGER, MORE_STEPS, OWN_VISCOSITY, discretisation_errors
from pacnerf_lpo.mpm.effects import KelvinVoigt
from pacnerf_lpo.mpm.materials import Newtonian
from pacnerf_lpo.mpm.physics import Physics
from tests.diagnosis import falling

RATE = 960.0


@pytest.fixture
def tried(monkeypatch):
    """What the models that were simulated are like."""
    found = []

    def path(model, free):
        numbers = model.physical(free)
        what = model.body.spacing, model.physics.substep_rate, numbers.get("solid_viscosity"), model.footprint
        found.append(SimpleNamespace(**dict(zip(("spacing", "rate", "viscosity", "footprint"), what, strict=True))))
        return model.body.positions.expand(falling.FRAMES, -1, -1)

    monkeypatch.setattr(BodyModel, "path", path)
    return found


def errors(problem, effects, known):
    model = problem.model(effects, known)
    bias = np.zeros((*problem.usable.shape,))
    return discretisation_errors(problem, model, model.start, bias)


@pytest.mark.parametrize("hidden", [None, 30.0])
def test_a_solid_may_be_coarser_and_dissipate_more(tried, hidden):
    problem = falling.Falling({})
    tried.clear()
    known = falling.GUESS if hidden is None else {**falling.GUESS, "solid_viscosity": hidden}
    found = errors(problem, () if hidden is None else (KelvinVoigt(),), known)
    assert found.shape == (*problem.usable.shape, 5)
    reference, coarse, often, viscous, large = tried
    own = OWN_VISCOSITY * problem.physics.rho * falling.SPACING**2 * RATE
    assert coarse.spacing > reference.spacing == often.spacing == viscous.spacing
    assert often.rate == MORE_STEPS * RATE and viscous.rate == large.rate == RATE
    assert viscous.viscosity == pytest.approx((hidden or 0.0) + own) and often.viscosity == hidden
    assert large.footprint == LARGER


def test_a_liquid_has_its_own_viscosity(tried):
    problem = falling.Falling({})
    problem.physics = Physics(Newtonian(mu=10.0, kappa=1e4), substep_rate=RATE, fit_ground_height=True)
    tried.clear()
    found = errors(problem, (), {**falling.GUESS, "mu": 10.0, "kappa": 1e4})
    assert found.shape == (*problem.usable.shape, 4) and all(one.viscosity is None for one in tried)
