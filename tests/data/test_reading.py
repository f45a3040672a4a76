"""What is read: cameras, scaling, silhouettes, occluders, views, and rays kept once."""

import numpy as np
import pytest
import torch
from PIL import Image

from pacnerf_lpo.data.assets import demo_scene
from pacnerf_lpo.data.cameras import hits_box, pixel_rays, project
from pacnerf_lpo.data.images import area_average, on_white, white_silhouette
from pacnerf_lpo.data.synthetic import hemisphere_rig
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.types import Box, Video
from tests.data.conftest import CENTRE, RADIUS, SIZE, load

BIRD = {"box_lower": [-0.6, 0.2, -0.4], "box_upper": [0.6, 1.0, 0.4]}


def test_rays_go_through_the_pixel_they_are_named_after():
    rig = hemisphere_rig(3, 16)
    pose, intrinsic = torch.tensor(rig.camera_to_world[1]), torch.tensor(rig.intrinsics[1])
    intrinsic[0, 2], intrinsic[1, 1] = 7.0, 20.0
    rays = pixel_rays(intrinsic, pose, height=6, width=16)
    pixels, depth = project((rays.origins + 1.7 * rays.directions).double(), intrinsic, pose)
    rows, columns = np.mgrid[0:6, 0:16]
    expected = torch.tensor(np.stack((columns, rows), -1).reshape(-1, 2) + 0.5)
    assert (depth > 0).all()
    # rays are float32: 1.7 m at a focal length of 30 pixels, a few roundings of 1.2e-7 each
    torch.testing.assert_close(pixels, expected, rtol=0.0, atol=1e-4)
    torch.testing.assert_close(rays.directions.norm(dim=-1), torch.ones(96))


def test_camera_looks_along_minus_z():
    pose = torch.eye(3, 4)
    intrinsic = torch.tensor([[8.0, 0.0, 1.0], [0.0, 8.0, 1.0], [0.0, 0.0, 1.0]])
    directions = pixel_rays(intrinsic, pose, 2, 2).directions
    assert (directions[:, 2] < 0).all()
    assert (directions[0, :2] * torch.tensor([-1.0, 1.0]) > 0).all()  # the first pixel is up on the left


def test_box_behind_the_camera_is_not_hit():
    rays = pixel_rays(torch.tensor([[8.0, 0, 4], [0, 8.0, 4], [0, 0, 1]]), torch.eye(3, 4), 8, 8)
    assert hits_box(rays, Box((-1, -1, -3), (1, 1, -2))).any()
    assert not hits_box(rays, Box((-1, -1, 2), (1, 1, 3))).any()


@pytest.mark.parametrize(("height", "width"), [(4, 6), (3, 5), (8, 12)])
def test_area_average_keeps_the_mean_and_the_constant(height, width):
    image = torch.rand(2, 8, 12, 3, generator=torch.Generator().manual_seed(0))
    averaged = area_average(image, height, width)
    # a sum of 96 float32 values: 96 * 6e-8 at most
    torch.testing.assert_close(averaged.mean((1, 2)), image.mean((1, 2)), rtol=0.0, atol=6e-6)
    torch.testing.assert_close(area_average(torch.ones(8, 12, 1), height, width), torch.ones(height, width, 1))


def test_halving_averages_two_by_two():
    image = torch.arange(16.0).reshape(4, 4, 1)
    assert area_average(image, 2, 2)[..., 0].tolist() == [[2.5, 4.5], [10.5, 12.5]]


def test_scaled_camera_sees_the_same_scene(scene):
    full, half = load(scene), load(scene, image_scale=0.5)
    assert half.video.images.shape[2:4] == (SIZE // 2, SIZE // 2)
    for video in (full.video, half.video):
        pixel, _ = project(torch.tensor(CENTRE[None]).float(), video.intrinsics[1], video.camera_to_world[1])
        grid = torch.stack(torch.meshgrid(*2 * [torch.arange(video.images.shape[2]) + 0.5], indexing="xy"), -1)
        weight = video.silhouettes[1, 0]
        centroid = (grid * weight[..., None]).sum((0, 1)) / weight.sum()
        # a ball's picture is centred on it up to perspective and rim pixels, 0.15 pixel here; half a pixel would show
        torch.testing.assert_close(centroid, pixel[0], rtol=0.0, atol=0.25)


def test_odd_scale_keeps_the_field_of_view(scene):
    video = load(scene, image_scale=0.3).video
    assert video.images.shape[2:4] == (10, 10)
    assert float(video.intrinsics[0, 0, 2]) == pytest.approx(5.0)


def test_silhouette_fills_highlights_and_keeps_holes():
    rows, columns = np.mgrid[0:64, 0:64] - 31.5
    distance = np.hypot(rows, columns)
    ring = (distance < 28) & (distance > 10)
    image = np.where(ring[..., None], 0.5, 1.0).astype(np.float32)
    image[10:12, 30:33] = 1.0
    assert np.array_equal(white_silhouette(image), ring.astype(np.float32))


def test_white_object_with_alpha_does_not_vanish():
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[..., 3] = 0.0
    pixels[2:6, 2:6, 3] = 0.75
    colour, silhouette = on_white(pixels)
    assert silhouette.sum() == 12.0 and (colour == 1.0).all()


def test_opaque_alpha_says_nothing_about_the_object():
    pixels = np.ones((8, 8, 4), np.float32)
    pixels[2:6, 2:6, :3] = 0.5
    assert on_white(pixels)[1].sum() == 16.0


def test_pixels_and_silhouettes_are_those_of_the_files(scene):
    video = load(scene).video
    stored = np.asarray(Image.open(scene / "data" / "m_2_3.png"), np.float32) / 255
    assert np.array_equal(video.images[2, 3].numpy(), stored)
    assert np.array_equal(video.silhouettes[2, 3].numpy() > 0, (stored < 1).any(-1))
    assert video.times.tolist() == pytest.approx([0, 1 / 24, 2 / 24, 3 / 24])


def test_silhouettes_agree_with_the_geometry(scene):
    """A ray meets the ball within half a sphere's radius of the silhouette's rim."""
    data = load(scene)
    for view in range(4):
        rays = data.rays(view)
        to_centre = torch.tensor(CENTRE).float() - rays.origins
        distance = torch.linalg.cross(to_centre, rays.directions).norm(dim=-1)
        solid = data.video.silhouettes[view, 0].flatten() > 0.5
        pixel = 2.5 / float(data.video.intrinsics[0, 0, 0])
        # spheres of 0.04 m on a 0.04 m lattice reach at most 0.04 m beyond the ball; a pixel is 0.042 m wide
        assert (distance[solid] < RADIUS + 0.04 + pixel).all()
        assert solid[distance < RADIUS - 0.04].all()


def test_views_are_chosen_by_file_number(scene):
    data = load(scene, train_views=[3, 1])
    assert data.video.view_ids == (0, 1, 2, 3)
    assert (data.train, data.test) == ([3, 1], [0, 2])
    only = load(scene, train_views=[3, 1], test_views=[])
    assert only.video.view_ids == (1, 3) and only.train == [1, 0] and only.test == []
    everything = load(scene)
    assert everything.train == [0, 1, 2, 3] and everything.test == []
    assert torch.equal(only.video.images, everything.video.images[[1, 3]])


@pytest.mark.parametrize("frames", [1, 2])
def test_frames_limit(scene, frames):
    assert load(scene, frames=frames).video.images.shape[:2] == (4, frames)


def test_occluder_masks_rays(scene):
    alpha = np.zeros((SIZE, SIZE, 4), np.uint8)
    alpha[4:8, 10:20, 3] = 51
    alpha[20, 20, 3] = 50
    Image.fromarray(alpha).save(scene / "data" / "r_1_-2.png")
    valid = load(scene).video.valid
    hidden = np.zeros((SIZE, SIZE), bool)
    hidden[4:8, 10:20] = True
    assert np.array_equal(~valid[1].numpy(), hidden) and valid[[0, 2, 3]].all()
    half = load(scene, image_scale=0.5).video.valid
    assert np.array_equal(~half[1].numpy(), hidden[::2, ::2])


def test_rays_are_in_memory_once(scene):
    data = load(scene)
    first = data.rays(2)
    data.setup("fit")
    again = data.rays(2)
    assert first is again and first.origins.untyped_storage().nbytes() == 12
    assert first.directions.shape == (SIZE * SIZE, 3)


def test_prepare_reads_once(scene):
    data = load(scene)
    video = data.video
    (scene / "all_data.json").unlink()
    assert data.prepare().video is video


def test_shipped_scene_is_small_and_complete():
    root = demo_scene()
    assert sum(path.stat().st_size for path in root.rglob("*")) <= 2_000_000
    data = VideoData("asset:bird", **BIRD, train_views=[0, 4, 8]).prepare()
    assert data.video.images.shape == (11, 14, 128, 128, 3)
    assert (root / "truth.json").exists() and data.video.source == str(root)


def hull_coverage(video: Video, shift: float) -> float:
    """Smallest fraction of a frame-0 silhouette that the visual hull covers; principal points moved by ``shift``."""
    axes = [torch.arange(low, high, 0.007) for low, high in zip(BIRD["box_lower"], BIRD["box_upper"], strict=True)]
    points = torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    silhouettes = video.silhouettes[:, 0] > 0.5
    intrinsics = video.intrinsics.clone()
    intrinsics[:, 0, 2] += shift

    def seen_in(view: int) -> tuple[torch.Tensor, torch.Tensor]:
        x, y = project(points, intrinsics[view], video.camera_to_world[view])[0].floor().long().clamp(0, 127).T
        return y, x

    for view in range(11):
        points = points[silhouettes[view][seen_in(view)]]
    covered = torch.zeros_like(silhouettes)
    for view in range(11):
        covered[view][seen_in(view)] = True
    return float(((covered & silhouettes).sum((1, 2)) / silhouettes.sum((1, 2))).min())


@pytest.mark.slow
def test_visual_hull_of_the_shipped_scene_fills_its_silhouettes():
    """Poses, axes and pixel centres fit the images: the hull fills every silhouette, and half a pixel off less well."""
    video = VideoData("asset:bird", **BIRD).prepare().video
    # points 0.007 m apart are 0.7 pixel apart, so a hull that fits leaves no gaps but at the rim
    coverage = hull_coverage(video, 0.0)
    assert coverage > 0.99
    assert coverage > max(hull_coverage(video, 0.5), hull_coverage(video, -0.5)) + 0.005
