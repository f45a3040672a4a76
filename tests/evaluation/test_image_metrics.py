"""Image metrics against direct formulas written independently here."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate1d

from pacnerf_lpo.evaluation import image_metrics
from pacnerf_lpo.evaluation.image_metrics import Missing


@pytest.fixture
def pair() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    measured = torch.rand(2, 32, 31, 3, generator=generator)
    return (measured + 0.1 * torch.randn(measured.shape, generator=generator)).clamp(0, 1), measured


def test_psnr_of_a_constant_offset_is_its_closed_form():
    measured = torch.full((2, 4, 4, 3), 0.5)
    offsets = torch.tensor([0.1, 0.01])[:, None, None, None]
    # 20 log10(1/offset); float32 rounding of 0.5 + 0.01 is 3e-8 / 0.01 relative, times 20 / ln 10
    torch.testing.assert_close(
        image_metrics.psnr(measured + offsets, measured), torch.tensor([20.0, 40.0]), atol=1e-4, rtol=0
    )


def test_psnr_of_equal_images_is_infinite_and_becomes_null_in_json():
    image = torch.rand(1, 16, 16, 3)
    metrics = image_metrics.image_scores(image, image).mean(torch.tensor([0]))
    assert math.isinf(image_metrics.psnr(image, image).item())
    assert metrics["psnr"] is None
    assert metrics["ssim"] == pytest.approx(1.0, abs=1e-6)


def ssim_by_definition(x: np.ndarray, y: np.ndarray) -> float:
    """Eq. 13 of Wang et al. 2004 with local moments under a Gaussian window; images are mirrored at their border."""
    window = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    window /= window.sum()

    def local_mean(image):
        return correlate1d(correlate1d(image, window, axis=0, mode="mirror"), window, axis=1, mode="mirror")

    mean_x, mean_y = local_mean(x), local_mean(y)
    var_x, var_y = local_mean(x * x) - mean_x**2, local_mean(y * y) - mean_y**2
    covariance = local_mean(x * y) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    return float(
        np.mean(
            (2 * mean_x * mean_y + c1) * (2 * covariance + c2) / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))
        )
    )


def test_ssim_agrees_with_its_definition(pair):
    predicted, measured = pair
    expected = [ssim_by_definition(a.double().numpy(), b.double().numpy()) for a, b in zip(*pair, strict=True)]
    # local variances are differences of O(1) float32 numbers: 1e-7 / c2 = 1e-4 relative
    np.testing.assert_allclose(image_metrics.ssim(predicted, measured).numpy(), expected, atol=1e-4)


def test_scores_are_averaged_over_the_chosen_images(pair):
    scores = image_metrics.image_scores(*pair)
    mean = scores.mean(torch.tensor([True, True]))
    assert mean["psnr"] == pytest.approx(scores.psnr.sum().item() / 2, rel=1e-5)
    assert scores.mean(torch.tensor([1]))["ssim"] == pytest.approx(scores.ssim[1].item(), rel=1e-6)


def test_lpips_without_torchvision_says_how_to_get_it(pair, monkeypatch):
    def refuse(**_):
        raise ModuleNotFoundError("LPIPS metric requires that torchvision is installed.")

    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", refuse)
    image_metrics._lpips_network.cache_clear()
    value = image_metrics.image_scores(*pair).mean(torch.tensor([0, 1]))["lpips"]
    image_metrics._lpips_network.cache_clear()
    assert str(value) == "n/a (torchvision is not installed: pip install 'pacnerf-lpo[lpips]')"


def test_lpips_without_weights_names_the_cause_on_one_line(pair, monkeypatch):
    def refuse(**_):
        raise OSError("no route\nto host")

    monkeypatch.setattr("torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity", refuse)
    image_metrics._lpips_network.cache_clear()
    value = image_metrics.lpips(*pair)
    image_metrics._lpips_network.cache_clear()
    assert isinstance(value, Missing)
    assert "no route" in str(value) and "\n" not in str(value)


def test_lpips_is_the_mean_of_the_network_over_images(pair, monkeypatch):
    """The code path with a network: channels first, one image at a time, averaged."""
    seen = []

    def network(a, b):
        seen.append(a.shape)
        return (a - b).abs().mean()[None]

    monkeypatch.setattr(image_metrics, "_lpips_network", lambda: network)
    value = image_metrics.image_scores(*pair).mean(torch.tensor([0, 1]))["lpips"]
    assert seen == [(1, 3, 32, 31)] * 2
    assert value == pytest.approx((pair[0] - pair[1]).abs().mean().item(), rel=1e-5)


def test_real_lpips_of_equal_images_is_zero(pair):
    pytest.importorskip("torchvision")
    value = image_metrics.lpips(pair[1], pair[1])
    if isinstance(value, Missing):
        pytest.skip(str(value))
    assert value.abs().max() < 1e-6
