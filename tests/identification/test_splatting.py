"""Summaries of outlines against shapes whose moments are known, and unions of discs against projected bodies."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.identification import forward_model, splatting
from pacnerf_lpo.identification.body import Sampling
from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.identification.silhouette_moments import (
    EDGE,
    KINDS,
    TAIL,
    mean_brightness,
    sensor_noise,
    silhouette_moments,
)
from pacnerf_lpo.identification.splatting import splat
from pacnerf_lpo.render.camera_faults import TimeOffset
from pacnerf_lpo.types import FieldGrid
from tests.diagnosis.falling import TRUTH, VIEWS, Falling, motion


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


def ball(x, y):
    """Signed distance from a ball [pixels]."""
    return torch.hypot(x - 40, y - 30) - 14


def ball_with_a_wing(x, y):
    """The same with a wing that ends, four pixels wide, far on the left, a little below."""
    along = ((x - 12) / 28).clamp(0, 1)
    return torch.minimum(ball(x, y), torch.hypot(x - 12 - 28 * along, y - 36 + 6 * along) - 2)


def box(x, y):
    return torch.maximum((x - 40.3).abs() - 15, (y - 30.3).abs() - 12)


@pytest.mark.parametrize("distance", [ball, ball_with_a_wing, box])
def test_sensor_noise_is_that_of_edges_that_err_by_themselves(distance):
    """The edge errs by so little that hardly any pixel of it becomes full or empty; along every combination of moments,
    the least certain and the most certain ones, too.
    """
    y, x = torch.meshgrid(torch.arange(60) + 0.5, torch.arange(80) + 0.5, indexing="ij")
    errors = 0.03 * torch.randn(600, 60, 80, generator=torch.Generator().manual_seed(0))
    measured = silhouette_moments((0.5 - distance(x, y) + errors).clamp(0, 1))
    root = sensor_noise((0.5 - distance(x, y)).clamp(0, 1)) * 0.03 / EDGE
    np.testing.assert_allclose(np.linalg.norm(root, axis=1) / np.std(measured, 0), 1.0, atol=0.12)
    variances = np.linalg.eigvalsh(np.cov(np.linalg.solve(root, measured.T)))
    assert variances[0] > 0.15 and variances[-1] < 1.5  # the least is that of a ball: size and widths nearly agree


def test_a_pointed_end_is_less_certain_than_a_round_one():
    y, x = torch.meshgrid(torch.arange(60) + 0.5, torch.arange(80) + 0.5, indexing="ij")
    sizes = np.linalg.norm(sensor_noise((0.5 - ball_with_a_wing(x, y)).clamp(0, 1)), axis=1)
    found = dict(zip(KINDS, sizes, strict=True))
    assert found["left"] > 3 * found["right"]


def test_an_outline_that_is_not_measured_has_no_noise():
    images = torch.stack((rectangle(0, 20, 20, 32), rectangle(10, 40, 20, 32)))
    assert np.isnan(sensor_noise(images)).all((-1, -2)).tolist() == [True, False]


def test_a_line_of_single_pixels_has_a_noise():
    assert np.isfinite(sensor_noise(rectangle(20, 21, 10, 40))).all()


def test_brightness_ignores_the_white_around():
    opacity = rectangle(10, 40, 20, 32)
    image = 1 - opacity[..., None] * torch.tensor([0.8, 0.6, 0.4])
    assert float(mean_brightness(image, opacity)) == pytest.approx(0.4, abs=1e-6)


SPACING, SCALE = 0.02, 150.0
"""Of particles [m], and pixels per metre."""
TURN = torch.from_numpy(Rotation.from_rotvec([0.3, -0.5, 0.4]).as_matrix()).float()


def drawn(distance, views):
    """Moments of a body, turned, as it is seen along each of its own axes; of it, its signed distance is known."""
    axis = torch.arange(-0.34, 0.34, SPACING / 4)
    values = distance(torch.cartesian_prod(axis, axis, axis) @ TURN).view(3 * (len(axis),))
    surface = FieldGrid(values, torch.zeros(*values.shape, 0), axis[0].expand(3), SPACING / 4)
    body = Sampling(surface, 2 * SPACING).body()
    points = body.positions @ TURN
    images = []
    for along in range(views):
        flat = SCALE * points[:, [i for i in range(3) if i != along]] + torch.tensor([48.3, 48.2])
        scale = torch.full((1, len(points)), SCALE)
        images.append(splat(flat[None], scale, body.discs, SPACING, (96, 96))[0])
    return [dict(zip(KINDS, silhouette_moments(image), strict=True)) for image in images]


def test_the_outline_of_a_ball_is_its_disc():
    (found,) = drawn(lambda points: 0.2 - points.norm(dim=1), 1)
    assert [found["x"], found["y"]] == pytest.approx([48.3, 48.2], abs=0.05)
    assert found["size"] == pytest.approx(np.sqrt(np.pi) * 0.2 * SCALE, abs=0.15)


@pytest.mark.parametrize("thickness", [0.4, 0.2, 0.1, 0.04])
def test_outlines_are_as_large_as_a_plate_however_thick_it_is(thickness):
    """Down to two particle spacings of three pixels each; seen face on and from two sides."""
    half = torch.tensor([0.2, 0.15, thickness / 2])

    def distance(points):
        beyond = points.abs() - half
        return -beyond.amax(1).clamp_max(0.0) - beyond.clamp_min(0.0).norm(dim=1)

    seen = drawn(distance, 3)
    sides = [(0.3, thickness), (0.4, thickness), (0.4, 0.3)]
    for found, (width, height) in zip(seen, sides, strict=True):
        across = found["size"] ** 2 / (SCALE * max(width, height))  # mean width in pixels of the shorter side
        assert across == pytest.approx(SCALE * min(width, height), abs=0.1 * SCALE * SPACING)


def alone(radius):
    """Discs of so many pixels, one around each particle, where a pixel is a metre wide."""
    depth = torch.tensor(radius)
    return Discs(torch.arange(len(depth))[:, None].expand(-1, 2), depth, torch.zeros(len(depth), 3))


def test_what_is_out_of_sight_is_not_drawn():
    pixels = torch.tensor([[[-30.0, 5.0], [500.0, 5.0], [5.0, 5.0], [torch.nan, 5.0], [9.0, 9.0], [9.0, 9.0]]])
    scale = torch.tensor([[1.0, 1.0, 1.0, 1.0, 1.0, 0.0]])
    image = splat(pixels, scale, alone([1.0, 2.0, 1.3, 1.0, -0.1, 1.0]), 10.0, (16, 16))[0]
    assert torch.equal(image, splat(pixels[:, 2:3], scale[:, 2:3], alone([1.3]), 10.0, (16, 16))[0])
    assert float(image.sum()) == pytest.approx(np.pi * 1.3**2, rel=0.1)


def test_images_do_not_mix():
    pixels, scale = torch.tensor([[[4.0, 4.0]], [[11.0, 12.0]]]), torch.ones(2, 1)
    both = splat(pixels, scale, alone([2.0]), 10.0, (16, 16))
    one_by_one = [splat(one[None], scale[:1], alone([2.0]), 10.0, (16, 16))[0] for one in pixels]
    assert torch.equal(both, torch.stack(one_by_one))


@pytest.fixture
def tilted():
    """Image coordinates and scale of particles before a near camera, the balls between them, and those balls drawn one
    by one, pixel by pixel [(1, N, 2), (1, N), Discs, (21, 30)]
    """
    generator = torch.Generator().manual_seed(0)
    positions = torch.rand(40, 3, generator=generator) - torch.tensor([0.5, 0.5, 2.0])
    ends = torch.randint(40, (60, 2), generator=generator)
    discs = Discs(ends, 0.15 * torch.rand(60, generator=generator), torch.zeros(60, 3))
    intrinsic, pose = torch.tensor([[20.0, 0, 15], [0, 20, 10.5], [0, 0, 1]]), torch.eye(4)[:3]
    centres, far = project(positions[ends].mean(1), intrinsic, pose)
    y, x = torch.meshgrid(torch.arange(21) + 0.5, torch.arange(30) + 0.5, indexing="ij")
    away = torch.hypot(x[..., None] - centres[:, 0], y[..., None] - centres[:, 1])
    pixels, depth = project(positions, intrinsic, pose)
    return pixels[None], 20 / depth[None], discs, (20 / far * discs.depth - away + 0.5).amax(-1).clamp(0, 1)


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_balls_between_particles_are_where_a_camera_sees_them(tilted, device, monkeypatch):
    """Also by rows, as on CUDA."""
    monkeypatch.setattr(splatting, "device", lambda: torch.device(device))
    pixels, scale, discs, expected = tilted
    np.testing.assert_allclose(splat(pixels, scale, discs, 10.0, (21, 30))[0], expected, atol=1e-4)


def test_what_is_deep_inside_is_drawn_as_if_half_a_spacing_below_the_surface():
    pixels, scale = torch.full((1, 1, 2), 20.0), torch.full((1, 1), 4.0)
    found = splat(pixels, scale, alone([9.0]), 2.0, (40, 40), footprint=1.5)
    expected = splat(pixels, scale, alone([1.5 * (1 + splatting.LEAST_DISC / 4)]), 1000.0, (40, 40))
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_views_are_drawn_together_as_each_alone(monkeypatch):
    """As many as there is room for; one has a clock of its own, which a single frame does not show."""
    model = Falling({}).model([TimeOffset(view=1)], {**TRUTH, "time_offset_view1": 0.03})
    path = motion(model, model.start)
    alone = torch.cat([model.outlines(path, model.start, [view]) for view in range(VIEWS)])
    right, late = model.outlines(path)[1], alone[1]
    assert (late[1:-1] - right[1:-1]).abs().amax((1, 2)).min() > 0.5
    for room in (forward_model.PARTICLES_AT_ONCE, 3 * path[..., 0].numel(), 1):
        monkeypatch.setattr(forward_model, "PARTICLES_AT_ONCE", room)
        assert torch.equal(model.outlines(path, model.start), alone)
        assert torch.equal(model.outlines(path, model.start, [3, 1]), alone[[3, 1]])
    (first,) = model.outlines(path[:1], model.start).swapaxes(0, 1)
    assert torch.equal(first, model.outlines(path)[:, 0])
