"""What cannot be simulated stops with an error that names the place and the cause."""

from __future__ import annotations

import math

import pytest
import torch

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.ground import Separate
from tests.mpm.engine import Setup, run_engine, simulate
from tests.mpm.scenes import BY_NAME, block

pytestmark = pytest.mark.usefixtures("small_threads")
SETUP = Setup("NeoHookean")


@pytest.mark.parametrize("name", ["positions", "velocity", "mass", "stiffness"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_non_finite_input(name, bad):
    particles = block()
    getattr(particles, name).view(-1)[5] = bad
    with pytest.raises((SimulationError, UserInputError), match=r"(?i)nan|finite|inf"):
        simulate(SETUP, particles)


def test_cfl_violation_names_frame_substep_and_cause():
    particles = block()
    particles.velocity += torch.tensor([100.0, 0.0, 0.0])
    with pytest.raises(SimulationError) as caught:
        simulate(Setup("NeoHookean", dt=1 / 300), particles)
    assert caught.value.frame == 0
    assert caught.value.substep <= 1
    assert "dx" in caught.value.cause
    assert "frame 0, substep" in str(caught.value)


def test_unstable_step_stops_in_a_later_substep():
    """A Young's modulus a thousand times too stiff for the step blows the body up; nothing is silently replaced."""
    with pytest.raises(SimulationError) as caught:
        simulate(SETUP, block(), E=2e9)
    assert 0 <= caught.value.frame < 4
    assert 0 <= caught.value.substep < SETUP.substeps


def test_particle_far_away():
    """One stray particle would need a grid of 1e15 nodes: refused, not allocated."""
    particles = block()
    particles.positions[3] = torch.tensor([1e4, 1e4, 1e4])
    with pytest.raises((SimulationError, UserInputError)):
        simulate(SETUP, particles)


def test_particle_leaving_the_grid():
    """A particle shot away leaves any bounded grid: either the grid follows it or the rollout stops with the cause."""
    particles = block(bottom=1.0)
    particles.velocity[3] = torch.tensor([200.0, 0.0, 0.0])
    particles.mass[3] *= 1e4
    try:
        trajectory = simulate(Setup("NeoHookean", substeps=120), particles, frames=40)
    except SimulationError as error:
        assert error.cause
    else:
        assert torch.isfinite(trajectory).all()


def test_unknown_and_missing_parameters():
    particles, values = vars(block()), BY_NAME["NeoHookean"].tensors()
    with pytest.raises(UserInputError, match="young"):
        run_engine(SETUP, particles, {**values, "young": values["E"]}, {})
    with pytest.raises(UserInputError, match="nu"):
        run_engine(SETUP, particles, {"E": values["E"]}, {})


@pytest.mark.parametrize(
    ("name", "wrong"), [("positions", (96, 2)), ("velocity", (3,)), ("mass", (95,)), ("stiffness", (96, 1))]
)
def test_wrong_shape_is_named(name, wrong):
    particles = {**vars(block()), name: torch.ones(*wrong, dtype=torch.float64)}
    with pytest.raises(UserInputError, match=name):
        run_engine(SETUP, particles, BY_NAME["NeoHookean"].tensors(), {})


def test_no_particles():
    with pytest.raises(UserInputError):
        run_engine(SETUP, {k: v[:0] for k, v in vars(block()).items()}, BY_NAME["NeoHookean"].tensors(), {})


@pytest.mark.parametrize(
    ("law", "bad"),
    [
        ("NeoHookean", {"E": -1.0}),
        ("NeoHookean", {"nu": 0.5}),
        ("NeoHookean", {"E": math.nan}),
        ("Newtonian", {"kappa": 0.0}),
        ("VonMises", {"tau_y": -5.0}),
        ("ViscoplasticVonMises", {"eta": -1.0}),
        ("DruckerPrager", {"theta": 95.0}),
    ],
)
def test_impossible_guess(law, bad):
    """Named with its unit when the material is made, before anything runs."""
    with pytest.raises(UserInputError, match=next(iter(bad))):
        getattr(materials, law)(**{**BY_NAME[law].parameters, **bad})


def test_unknown_known_parameter():
    with pytest.raises(UserInputError, match="young"):
        materials.NeoHookean(1e5, 0.3, known=["young"])


def test_negative_friction():
    with pytest.raises(UserInputError, match="friction"):
        Separate(-0.1)
