"""Rendering happens on the device of the process, everything around it on the CPU."""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.evaluation import prediction
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.mpm import runtime
from pacnerf_lpo.phases import image_cost
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.render.ray_march import Rendering
from tests.phases.conftest import SIZE


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> dict[str, set[str]]:
    """A device that is not the CPU: torch's meta tensors, which have shapes and no values. Says what was used there."""
    seen: dict[str, set[str]] = {"grid": set(), "rays": set(), "colour": set()}
    monkeypatch.setattr(runtime, "_started", {"kind": "meta", "threads": 1})

    def to_grid(positions, density, features, spacing):
        seen["grid"] |= {positions.device.type, density.device.type, features.device.type}

    def render(grid, colour, rays, *_):
        seen["rays"] |= {rays.origins.device.type, rays.directions.device.type}
        seen["colour"] |= {parameter.device.type for parameter in colour.parameters()}
        return Rendering(torch.ones(len(rays.origins), 3), torch.ones(len(rays.origins)))

    for module in (image_cost, prediction):
        monkeypatch.setattr(module, "particles_to_grid", to_grid)
    monkeypatch.setattr(image_cost, "render_rays", render)
    monkeypatch.setattr("pacnerf_lpo.render.image.render_rays", render)
    return seen


def test_the_cost_renders_there_and_compares_here(elsewhere: dict[str, set[str]], data, state):
    residual = ImageCost(data, state, 1.0).residual(state.positions, state.density, state.features, 0, 0)
    assert elsewhere == {"grid": {"meta"}, "rays": {"meta"}, "colour": {"meta"}}
    assert residual.device.type == "cpu" and residual.shape == (SIZE, SIZE, 4)


def test_predictions_are_rendered_there(elsewhere: dict[str, set[str]], data, state):
    renderer = StateRenderer(state)
    image, opacity = renderer.image(renderer.grid(state.positions), data.rays(0), (SIZE, SIZE))
    assert elsewhere == {"grid": {"meta"}, "rays": {"meta"}, "colour": {"meta"}}
    assert image.device.type == opacity.device.type == "cpu"
