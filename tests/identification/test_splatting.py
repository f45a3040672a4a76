"""Summaries of outlines against shapes whose moments are known, and splatting against the projected disc."""

import numpy as np
import pytest
import torch

from pacnerf_lpo.identification.silhouette_moments import KINDS, TAIL, mean_brightness, sensor_noise, silhouette_moments
from pacnerf_lpo.identification.splatting import splat


def rectangle(left, right, top, bottom, size=(60, 80)):
    image = torch.zeros(size)
    image[top:bottom, left:right] = 1.0
    return image


def test_summaries_of_a_rectangle():
    found = dict(zip(KINDS, silhouette_moments(rectangle(10, 40, 20, 32)), strict=True))
    # a uniform density over a width w has the standard deviation sqrt((w^2 - 1) / 12) of pixel centres
    expected = {
        "x": 25.0,
        "y": 26.0,
        "size": np.sqrt(30 * 12),
        "width": np.sqrt((30**2 - 1) / 12),
        "height": np.sqrt((12**2 - 1) / 12),
        "skew": 0.0,
        "left": 10 + 30 * TAIL,
        "right": 40 - 30 * TAIL,
        "top": 20 + 12 * TAIL,
        "bottom": 32 - 12 * TAIL,
    }
    assert found == pytest.approx(expected, abs=1e-6)


def test_a_shift_by_part_of_a_pixel_moves_the_centroid_by_as_much():
    image = rectangle(10, 40, 20, 32)
    shifted = 0.7 * image + 0.3 * torch.roll(image, 1, 1)
    assert silhouette_moments(shifted)[0] - silhouette_moments(image)[0] == pytest.approx(
        0.3, abs=1e-7
    )  # float32 images


def test_an_outline_at_the_border_or_without_area_is_not_measured():
    assert np.isnan(silhouette_moments(rectangle(0, 20, 20, 32))).all()
    assert np.isnan(silhouette_moments(torch.zeros(60, 80))).all()
    assert np.isfinite(silhouette_moments(rectangle(1, 20, 20, 32))).all()


def test_a_margin_keeps_the_coordinates_of_the_camera():
    image = rectangle(10, 40, 20, 32)
    wider = torch.nn.functional.pad(image, (7, 7, 7, 7))
    assert silhouette_moments(wider, margin=7) == pytest.approx(silhouette_moments(image), abs=1e-9)


def test_sensor_noise_is_that_of_jittered_edges():
    """The formula against summaries of squares whose four edges err independently by 0.3 pixels per pixel of edge."""
    generator = torch.Generator().manual_seed(0)
    drawn = []
    for _ in range(400):
        image = rectangle(20, 50, 15, 45)
        jitter = 0.3 * torch.randn(4, 30, generator=generator)
        image[15:45, 20] += jitter[0].clamp(-1, 0)
        image[15:45, 19] += jitter[0].clamp(0, 1)
        image[15:45, 49] += jitter[1].clamp(-1, 0)
        image[15:45, 50] += jitter[1].clamp(0, 1)
        image[15, 20:50] += jitter[2].clamp(-1, 0)
        image[14, 20:50] += jitter[2].clamp(0, 1)
        image[44, 20:50] += jitter[3].clamp(-1, 0)
        image[45, 20:50] += jitter[3].clamp(0, 1)
        drawn.append(silhouette_moments(image))
    measured = np.std(drawn, 0)
    predicted = sensor_noise(silhouette_moments(rectangle(20, 50, 15, 45)))
    # an estimate of size: it assumes an outline of 1.5 times a circle's and no particular shape
    for kind in ("x", "y", "size", "width", "height"):
        assert 0.5 < predicted[KINDS.index(kind)] / measured[KINDS.index(kind)] < 2.0, kind


def test_brightness_ignores_the_white_around():
    opacity = rectangle(10, 40, 20, 32)
    image = 1 - opacity[..., None] * torch.tensor([0.8, 0.6, 0.4])
    assert float(mean_brightness(image, opacity)) == pytest.approx(0.4, abs=1e-6)


def test_a_splatted_ball_has_the_area_of_its_disc():
    apart = 1.37  # not commensurate with the pixels
    axis = torch.arange(-20, 21) * apart
    points = torch.cartesian_prod(axis, axis, axis)
    ball = points[points.norm(dim=1) < 22]
    image = splat(ball[None, :, :2] + 32.3, torch.ones(len(ball)), (64, 64), torch.tensor([apart]))[0]
    found = dict(zip(KINDS, silhouette_moments(image), strict=True))
    assert found["x"] == pytest.approx(32.3, abs=0.05)
    # particles stand half a spacing inside the surface and are blurred by as much
    assert found["size"] == pytest.approx(np.sqrt(np.pi) * 22, abs=np.sqrt(np.pi) * 0.5 * apart)


def test_points_outside_the_image_are_dropped():
    pixels = torch.tensor([[[-30.0, 5.0], [500.0, 5.0], [5.0, 5.0]]])
    image = splat(pixels, torch.ones(3), (16, 16), torch.tensor([1.0]))[0]
    alone = splat(pixels[:, 2:], torch.ones(1), (16, 16), torch.tensor([1.0]))[0]
    assert torch.equal(image, alone)
