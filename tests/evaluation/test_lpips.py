"""LPIPS through torchmetrics, with an AlexNet of random weights in place of torchvision's, and without its weights."""

from __future__ import annotations

import inspect
import sys
import types
import urllib.error
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
import torchmetrics.functional.image.lpips as of_torchmetrics
from torch import nn

from pacnerf_lpo.evaluation import image_metrics
from pacnerf_lpo.evaluation.image_metrics import Missing

Pair = tuple[torch.Tensor, torch.Tensor]


def alexnet_features() -> nn.Sequential:
    """The convolutional part of AlexNet (Krizhevsky 2014), randomly initialised."""
    generator = torch.random.get_rng_state()
    torch.manual_seed(0)
    layers = [
        *(nn.Conv2d(3, 64, 11, stride=4, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(192, 384, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(384, 256, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(256, 256, 3, padding=1), nn.ReLU(), nn.MaxPool2d(3, 2)),
    ]
    torch.random.set_rng_state(generator)
    return nn.Sequential(*layers).eval()


@pytest.fixture
def pair(small_threads: None) -> Pair:
    generator = torch.Generator().manual_seed(1)
    measured = torch.rand(2, 48, 64, 3, generator=generator)
    return (measured + 0.1 * torch.randn(measured.shape, generator=generator)).clamp(0, 1), measured


@pytest.fixture
def torchvision(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Callable], None]]:
    """Puts a stand-in for torchvision where torchmetrics looks for it; its AlexNet is made by the function given."""

    def install(alexnet: Callable) -> None:
        module, models = types.ModuleType("torchvision"), types.ModuleType("torchvision.models")
        models.AlexNet_Weights = types.SimpleNamespace(DEFAULT="imagenet")
        models.alexnet, module.models = alexnet, models
        monkeypatch.setitem(sys.modules, "torchvision", module)
        monkeypatch.setitem(sys.modules, "torchvision.models", models)
        monkeypatch.setattr("torchmetrics.functional.image.lpips._TORCHVISION_AVAILABLE", True)
        monkeypatch.setattr("torchmetrics.image.lpip._TORCHVISION_AVAILABLE", True)
        image_metrics._lpips_network.cache_clear()

    yield install
    image_metrics._lpips_network.cache_clear()


def by_definition(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """Eq. 1 of Zhang et al. 2018: squared distances of unit feature vectors, weighted by channel, averaged over space.

    Args:
        one, other: (B, H, W, 3) in 0..1.
    """
    file = Path(inspect.getfile(of_torchmetrics)).parent / "lpips_models" / "alex.pth"
    weights = torch.load(file, weights_only=True, map_location="cpu")
    shift, scale = torch.tensor([-0.030, -0.088, -0.188]), torch.tensor([0.458, 0.448, 0.450])
    x, y = (((2 * image - 1 - shift) / scale).movedim(-1, 1) for image in (one, other))
    distance, tap = torch.zeros(len(one)), 0
    for layer in alexnet_features()[:12]:  # up to the fifth activation
        x, y = layer(x), layer(y)
        if isinstance(layer, nn.ReLU):
            units = [feature / (feature.norm(dim=1, keepdim=True) + 1e-12) for feature in (x, y)]
            difference = (units[0] - units[1]).square()
            distance += (weights[f"lin{tap}.model.1.weight"] * difference).sum(1).mean((1, 2))
            tap += 1
    assert tap == 5
    return distance


def test_lpips_is_its_definition(pair: Pair, torchvision):
    torchvision(lambda weights: types.SimpleNamespace(features=alexnet_features()))
    value = image_metrics.lpips(*pair)
    assert isinstance(value, torch.Tensor)
    with torch.no_grad():
        expected = by_definition(*pair)
    assert expected.min() > 1e-3
    # torchmetrics adds 1e-8 under the root of the norm: 1e-8 / norm^2 relative, and float32
    torch.testing.assert_close(value, expected, rtol=1e-3, atol=1e-6)


def test_lpips_of_equal_images_is_zero_and_goes_into_the_scores(pair: Pair, torchvision):
    torchvision(lambda weights: types.SimpleNamespace(features=alexnet_features()))
    scores = image_metrics.image_scores(pair[1], pair[1]).mean(torch.tensor([0, 1]))
    assert scores["lpips"] == 0.0


def test_without_its_weights_there_is_a_reason_and_no_number(pair: Pair, torchvision):
    def alexnet(weights: str) -> None:
        assert weights == "imagenet"  # the trained ones are asked for
        raise urllib.error.URLError("Temporary failure in name resolution")

    torchvision(alexnet)
    said = image_metrics.image_scores(*pair).mean(torch.tensor([0]))["lpips"]
    assert isinstance(said, str)
    assert said.startswith("n/a (the AlexNet weights could not be downloaded") and "name resolution" in said


def test_images_too_small_for_the_network(torchvision):
    torchvision(lambda weights: types.SimpleNamespace(features=alexnet_features()))
    small = torch.rand(1, 30, 40, 3)
    assert isinstance(image_metrics.lpips(small, small), Missing)
    enough = torch.rand(1, 31, 40, 3)
    assert isinstance(image_metrics.lpips(enough, enough), torch.Tensor)
