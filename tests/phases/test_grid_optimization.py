"""+GO on a block whose film is known."""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.phases import GridOptimizationModule
from pacnerf_lpo.phases.image_cost import ImageCost
from tests.phases.conftest import FRAMES, film, physics
from tests.phases.test_dynamic_phases import run


def imported(data, state) -> GridOptimizationModule:
    """The phase with a state's particles made into its grid."""
    phase = GridOptimizationModule(iterations=10)
    phase.attach(data, physics())
    phase.import_state(state)
    return phase


def test_it_lowers_the_cost_of_wrong_colours_and_keeps_what_is_frozen(data, state):
    """On a body that was sampled from a grid, filmed in strong colours; the wrong one has their opposites."""
    vivid = {name: 30 * value if name == "last.weight" else value for name, value in state.colour_network.items()}
    true = imported(data, state).export_state().with_(colour_network=vivid)
    path = physics().simulate(true, FRAMES)
    seen = film(true, path)

    def cost(found) -> float:
        path = physics().simulate(found, FRAMES)[None]
        return ImageCost(seen, found).loss(path, found.density, found.features, [[0, 1, 2]] * FRAMES).item()

    wrong = true.with_(features=-true.features)
    corrected = run(GridOptimizationModule(iterations=10), seen, physics(), wrong)
    assert cost(corrected) < 0.8 * cost(wrong)
    assert corrected.physics == wrong.physics and (corrected.velocity == wrong.velocity[0]).all()
    assert len(corrected.positions) == len(corrected.density) == len(corrected.features)


def test_particles_are_sampled_anew_and_the_grid_gets_their_gradient(data, state):
    phase = imported(data, state)
    one, other = (phase.particles(torch.Generator().manual_seed(seed)) for seed in (0, 1))
    assert one[0].shape != other[0].shape or not torch.equal(one[0], other[0])
    assert not one[0].requires_grad
    one[1].sum().backward()  # trilinear weights of a particle add up to one
    assert phase.density.grad.sum().item() == pytest.approx(len(one[0]), rel=1e-5)


def test_equal_runs_export_equal_particles(data, state):
    one, other = (run(GridOptimizationModule(iterations=2, seed=3), data, physics(), state) for _ in range(2))
    for name in ("positions", "density", "features"):
        assert torch.equal(getattr(one, name), getattr(other, name))


def test_a_body_that_vanishes_is_one_line(data, state):
    phase = imported(data, state)
    with torch.no_grad():
        phase.density.fill_(-100.0)
    with pytest.raises(UserInputError, match="vanished"):
        phase.export_state()
