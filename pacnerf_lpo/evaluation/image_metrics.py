"""PSNR, SSIM and LPIPS between a predicted and a measured video of one view.

Each is computed per image and averaged over the images: "averaged over the test-view videos" (LPO supplement, E.4).
"""

import functools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torchmetrics.functional.image import structural_similarity_index_measure

LPIPS_INSTALL = "torchvision is not installed: pip install 'pacnerf-lpo[lpips]'"
LPIPS_PIXELS = 31  # below it, AlexNet's second pooling has nothing left to pool


@dataclass(frozen=True)
class Missing:
    """A number that could not be computed here, and why: printed as ``n/a (reason)``, never replaced by a guess."""

    reason: str

    def __str__(self) -> str:
        return f"n/a ({self.reason})"


@dataclass(frozen=True)
class ImageScores:
    """Of every image: ``psnr`` [dB], ``ssim`` [1], ``lpips`` [1, lower is better] or :class:`Missing`, of one shape."""

    psnr: Tensor
    ssim: Tensor
    lpips: Tensor | Missing

    def mean(self, where: Tensor | tuple[list[int], slice]) -> dict[str, float | str | None]:
        """The averages over the images that the boolean mask or index ``where`` selects, as plain values for JSON: a
        missing metric is its printed reason, an infinite PSNR is None.
        """
        psnr, distance = self.psnr[where].mean().item(), self.lpips
        lpips = str(distance) if isinstance(distance, Missing) else distance[where].mean().item()
        return {"psnr": psnr if math.isfinite(psnr) else None, "ssim": self.ssim[where].mean().item(), "lpips": lpips}


def psnr(predicted: Tensor, measured: Tensor) -> Tensor:
    """Peak signal-to-noise ratio of each image, -10 log10(mean squared error), for values in 0..1 (B, H, W, 3) [dB,
    (B,)]; infinite where the two images are equal.
    """
    return -10.0 * torch.log10(mean_squared_error(predicted, measured))


def mean_squared_error(predicted: Tensor, measured: Tensor) -> Tensor:
    """Mean over pixels and channels of each image's squared difference, (B, H, W, 3) -> (B,)."""
    return (predicted - measured).square().flatten(1).mean(1)


def ssim(predicted: Tensor, measured: Tensor) -> Tensor:
    """Structural similarity of each image with the usual 11 x 11 Gaussian window, sigma 1.5 (Wang et al. 2004, eq. 13)
    [(B,)], 1 where the two images are equal; (B, H, W, 3) in 0..1, at least 11 pixels wide and high.

    The mean runs over every pixel; the images are mirrored at their border (torchmetrics).
    """
    values = structural_similarity_index_measure(
        _channels_first(predicted), _channels_first(measured), data_range=1.0, reduction="none"
    )
    return values if isinstance(values, Tensor) else values[0]


def lpips(predicted: Tensor, measured: Tensor) -> Tensor | Missing:
    """Learned perceptual distance of each image (Zhang et al. 2018, AlexNet) [(B,)], or why it cannot be had: no
    torchvision, or no weights of the network, or the images, (B, H, W, 3) in 0..1, are too small.
    """
    network = _lpips_network()
    if isinstance(network, Missing):
        return network
    if min(predicted.shape[1:3]) < LPIPS_PIXELS:
        return Missing(f"the network wants at least {LPIPS_PIXELS} pixels a side")
    with torch.no_grad():
        pairs = zip(_channels_first(predicted).split(1), _channels_first(measured).split(1), strict=True)
        return torch.stack([network(a, b).reshape(()) for a, b in pairs])


def image_scores(predicted: Tensor, measured: Tensor) -> ImageScores:
    """All three metrics of every image of a stack, (B, H, W, 3) in 0..1."""
    predicted, measured = predicted.clamp(0, 1), measured.clamp(0, 1)
    return ImageScores(psnr(predicted, measured), ssim(predicted, measured), lpips(predicted, measured))


@functools.cache
def _lpips_network() -> Callable[[Tensor, Tensor], Tensor] | Missing:
    """The network of torchmetrics, built once; its AlexNet weights are downloaded by torchvision on first use."""
    from torchmetrics.image.lpip import LearnedPerceptualImagePatchSimilarity

    try:
        return LearnedPerceptualImagePatchSimilarity(net_type="alex", normalize=True).eval()
    except ModuleNotFoundError:
        return Missing(LPIPS_INSTALL)
    except OSError as error:
        return Missing(f"the AlexNet weights could not be downloaded: {json.dumps(str(error))[1:-1][:120]}")


def _channels_first(images: Tensor) -> Tensor:
    return images.movedim(-1, -3).contiguous()
