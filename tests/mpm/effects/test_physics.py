"""How effects meet material, ground and each other in :class:`Physics`."""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import effects
from pacnerf_lpo.mpm.ground import Separate, Slip
from pacnerf_lpo.mpm.materials import DruckerPrager, Material, NeoHookean, Newtonian, ViscoplasticVonMises, VonMises
from pacnerf_lpo.mpm.physics import Physics

pytestmark = pytest.mark.usefixtures("small_threads")
UNSUITED = [
    (effects.Cohesion, NeoHookean),
    (effects.ShearThinning, NeoHookean),
    (effects.ShearThinning, VonMises),
    (effects.YieldStress, VonMises),
    (effects.YieldStress, Newtonian),
    (effects.YieldStress, DruckerPrager),
    (effects.KelvinVoigt, Newtonian),
]
SUITED = [
    (effects.Cohesion, DruckerPrager),
    (effects.ShearThinning, Newtonian),
    (effects.ShearThinning, ViscoplasticVonMises),
    (effects.YieldStress, NeoHookean),
    (effects.KelvinVoigt, VonMises),
    (effects.SurfaceTension, Newtonian),
]


@pytest.mark.parametrize(("effect", "material"), UNSUITED)
def test_effects_refuse_materials_without_their_physics(effect: type[effects.Effect], material: type[Material]):
    with pytest.raises(UserInputError, match=f"effect {effect.__name__}: {material.__name__}"):
        Physics(material(), effects=[effect()])  # type: ignore[call-arg]


@pytest.mark.parametrize(("effect", "material"), SUITED)
def test_effects_add_their_parameters(effect: type[effects.Effect], material: type[Material]):
    physics = Physics(material(), effects=[effect()])  # type: ignore[call-arg]
    assert physics.free_names == [*material.parameters, *effect.parameters]
    assert {name: physics.guess[name] for name in effect.null} == effect.null
    assert set(effect.parameters) <= set(physics.parameters)


def test_one_ground_effect_on_a_sticky_ground():
    with pytest.raises(UserInputError, match="GroundFriction and Adhesion each replace the ground"):
        Physics(NeoHookean(), effects=[effects.GroundFriction(), effects.Adhesion()])
    for ground in (Slip(), Separate()):
        with pytest.raises(UserInputError, match=f"is Sticky, but it is {type(ground).__name__}"):
            Physics(NeoHookean(), ground, [effects.GroundFriction()])


def test_an_effect_must_not_take_the_name_of_a_coefficient():
    class Named(effects.LinearDrag):
        parameters = {"lam": effects.LinearDrag.parameters["drag"]}  # noqa: RUF012
        null = {"lam": 0.0}  # noqa: RUF012

        def __init__(self):
            effects.BodyForce.__init__(self, {"lam": 0.0})

    with pytest.raises(UserInputError, match="two parameters 'lam'"):
        Physics(NeoHookean(), effects=[Named()])


@pytest.mark.slow
def test_initial_state_effects_act_in_a_rollout_of_physics():
    """omega x r for half a frame's worth of substeps; r is measured from the centre of mass, in a lattice the mean."""
    axis = torch.arange(4) * 0.05
    positions = torch.cartesian_prod(axis, axis + 1.0, axis)
    physics = Physics(NeoHookean(), effects=[effects.InitialSpin()], substep_rate=480.0, gravity=(0.0, 0.0, 0.0))
    values = {name: torch.tensor(value) for name, value in physics.guess.items()}
    values["spin_y"] = torch.tensor(2.0, requires_grad=True)
    path = physics.rollout(positions, torch.zeros(64, 3), torch.full((64,), 40.0), values, (0.1, 0.1), 2)
    moved, arm = path[1] - path[0], positions - positions.mean(0)
    # the path of a turn by 2 / 24 rad: straight up to its square, 0.7 %
    expected = torch.stack([arm[:, 2], torch.zeros(64), -arm[:, 0]], 1) * 2 / 24
    assert (moved - expected).norm() < 0.06 * expected.norm()
    (gradient,) = torch.autograd.grad((moved * expected).sum(), values["spin_y"])
    assert float(gradient) == pytest.approx(float((expected * expected).sum()) / 2, rel=0.06)
