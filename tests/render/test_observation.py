"""Camera faults: closed forms of what they do to a view, and gradients."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.render.camera_faults import (
    CameraDrift,
    CameraRotation,
    CameraShift,
    Exposure,
    Observation,
    RadialDistortion,
    TimeOffset,
)
from pacnerf_lpo.render.observation import Observer, between_frames
from pacnerf_lpo.types import Video

FOCAL, SIZE, STEP = 200.0, 64, 1 / 24
EFFECTS = [CameraDrift, CameraRotation, CameraShift, Exposure, RadialDistortion, TimeOffset]


def double(numbers) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def filmed(frames: int = 4) -> SimpleNamespace:
    """Two cameras (file ids 3 and 5): one at the origin looking along -z, one tilted; in float64, images empty."""
    c, s = math.cos(0.4), math.sin(0.4)
    tilted = double([[1, 0, 0], [0, c, s], [0, -s, c]])
    poses = torch.zeros(2, 3, 4, dtype=torch.float64)
    poses[0, :, :3], poses[1, :, :3] = torch.eye(3), tilted
    poses[1, :, 3] = torch.tensor([0.1, 0.2, 0.3])
    intrinsic = double([[FOCAL, 0, SIZE / 2], [0, FOCAL, SIZE / 2], [0, 0, 1]])
    video = Video(
        images=torch.ones(2, frames, SIZE, SIZE, 3),
        silhouettes=torch.zeros(2, frames, SIZE, SIZE),
        valid=torch.ones(2, SIZE, SIZE, dtype=torch.bool),
        camera_to_world=poses,
        intrinsics=intrinsic.expand(2, 3, 3),
        times=5.0 + STEP * torch.arange(frames, dtype=torch.float64),  # stamps need not start at 0
        view_ids=(3, 5),
        frame_ids=tuple(range(frames)),
    )
    rays = [pixel_rays(intrinsic, pose, SIZE, SIZE) for pose in poses]
    return SimpleNamespace(video=video, rays=lambda view: rays[view])


def values_of(*effects: Observation) -> dict[str, torch.Tensor]:
    return {name: double(v) for effect in effects for name, v in effect.guess.items()}


def displacement(effect: Observation, points: torch.Tensor, frame: int = 0) -> torch.Tensor:
    """By how many pixels points [m] move in view 3 through the effect [(N, 2)]."""
    video = filmed().video
    seen, believed = Observer([effect], values_of(effect)), Observer()
    return seen.project(points, video, 0, frame)[0] - believed.project(points, video, 0, frame)[0]


@pytest.fixture
def points() -> torch.Tensor:
    """Points 1 to 3 m before the first camera [m, (20, 3)]."""
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(20, 3, generator=generator, dtype=torch.float64)
    return (points - 0.5) * torch.tensor([0.3, 0.3, 2.0]) - torch.tensor([0.0, 0.0, 2.0])


def test_a_shifted_camera_sees_points_move_by_f_dx_over_z(points):
    moved = displacement(CameraShift(0.02, -0.01, view=3), points)
    depth = -points[:, 2:]
    expected = FOCAL * double([[-0.02, -0.01]]) / depth  # pixel rows count downwards
    torch.testing.assert_close(moved, expected)
    assert (displacement(CameraShift(0.02, view=5), points) == 0).all(), "it concerns the other camera"


def test_a_drifting_camera_has_moved_by_speed_times_time(points):
    effect = CameraDrift(drift_x=0.3, view=3)
    assert (displacement(effect, points, frame=0) == 0).all()
    expected = -FOCAL * 0.3 * 2 * STEP / -points[:, 2]
    torch.testing.assert_close(displacement(effect, points, frame=2)[:, 0], expected)


def test_a_turned_camera_shows_its_axis_at_f_tan():
    axis, reach = double([[0.0, 0.0, -2.0]]), FOCAL * math.tan(math.radians(3))
    torch.testing.assert_close(displacement(CameraRotation(pan=3), axis), double([[reach, 0.0]]))
    torch.testing.assert_close(displacement(CameraRotation(tilt=3), axis), double([[0.0, reach]]))


def test_a_rolled_camera_turns_the_image(points):
    video, effect = filmed().video, CameraRotation(roll=30)
    centre = SIZE / 2
    before = Observer().project(points, video, 0, 0)[0] - centre
    after = Observer([effect], values_of(effect)).project(points, video, 0, 0)[0] - centre
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    # a camera rolled to the left (x towards y) sees the world turned to the right; rows count downwards
    torch.testing.assert_close(after, before @ double([[c, s], [-s, c]]))


def test_a_lens_stretches_by_one_plus_k1_r_squared(points):
    moved = displacement(RadialDistortion(0.3), points)
    ideal = points[:, :2] / -points[:, 2:]
    expected = FOCAL * 0.3 * ideal * ideal.square().sum(1, keepdim=True) * torch.tensor([1.0, -1.0])
    torch.testing.assert_close(moved, expected)


@pytest.mark.parametrize("k1", [-0.45, 0.8])
def test_points_on_a_ray_project_into_its_pixel(k1):
    effects = [
        CameraShift(0.05, 0.02, view=5), CameraRotation(1, 2, 3), RadialDistortion(k1), CameraDrift(0.4, -0.2)
    ]  # fmt: skip
    data, values = filmed(), values_of(*effects)
    rays = Observer(effects, values).rays(data, 1, 3)
    along = rays.origins + rays.directions * torch.linspace(0.5, 3, SIZE**2)[:, None]
    pixels, depth = Observer(effects, values).project(along.double(), data.video, 1, 3)
    rows, columns = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    # rays are float32: 3 m / 0.5 m * 2^-24 * 200 pixels < 1e-4 pixels
    torch.testing.assert_close(pixels, torch.stack((columns, rows), -1).reshape(-1, 2).double(), rtol=0, atol=1e-4)
    assert (depth > 0).all()
    believed = data.rays(1).directions
    assert (rays.directions - believed).norm(dim=1).max() > 0.02


def test_a_gain_scales_the_object_and_not_the_white_behind_it():
    effect, video = Exposure(0.8, view=3), filmed().video
    observer = Observer([effect], values_of(effect))
    transmittance = torch.tensor([0.0, 0.5, 1.0])
    objects = torch.rand(3, 3, generator=torch.Generator().manual_seed(0)) * (1 - transmittance)[:, None]
    colour = objects + transmittance[:, None]
    seen = observer.colour(colour, transmittance, video, 0, 0)
    torch.testing.assert_close(seen, (0.8 * objects + transmittance[:, None]).to(seen))
    assert observer.colour(colour, transmittance, video, 1, 0) is colour


@pytest.mark.parametrize("frames", [-1.5, -0.2, 0.0, 0.35, 1.7])
def test_a_wrong_clock_sees_a_free_fall_at_another_time(frames):
    """The interpolation has at least degree two everywhere: a parabola is exact, also outside the frames."""
    effect = TimeOffset(frames * STEP, view=5)
    start = torch.randn(6, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    velocity, gravity = 0.5 * start.flip(0), torch.tensor([0.0, -9.8, 0.0])
    times = 5.0 + STEP * torch.arange(5, dtype=torch.float64)

    def fall(t: torch.Tensor) -> torch.Tensor:
        return start + velocity * t[:, None, None] + 0.5 * gravity * t[:, None, None] ** 2

    path = fall(times - 5.0)
    observer = Observer([effect], values_of(effect))
    seen = observer.seen_by(5, path, velocity, times)
    torch.testing.assert_close(seen, fall(times - 5.0 + frames * STEP))
    assert observer.seen_by(3, path, velocity, times) is path


def test_frames_are_seen_as_they_are_and_only_wrong_clocks_are_computed():
    path = torch.randn(5, 4, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    whole = torch.arange(5, dtype=torch.float64)
    torch.testing.assert_close(between_frames(path, path[0], whole, double(STEP)), path)
    effects = [TimeOffset(0.01, view=5), TimeOffset(0.02)]
    observer, times = Observer(effects, values_of(*effects)), STEP * whole
    seen = observer.seen(path, path[0], times)
    assert (observer.clock(3), observer.clock(5), observer.clock(7), len(seen)) == (0, 1, 0, 2)
    late = TimeOffset(0.03)
    torch.testing.assert_close(seen[1], Observer([late], values_of(late)).seen_by(None, path, path[0], times))


def test_without_effects_nothing_is_computed():
    data, path = filmed(), torch.zeros(3, 2, 3)
    observer = Observer([Exposure(0.5)], values_of(Exposure(0.5)))
    for nothing in (Observer(), observer):
        assert nothing.rays(data, 0, 1) is data.rays(0)
        assert nothing.seen(path, path[0], torch.arange(3.0)).data_ptr() == path.data_ptr()


@pytest.mark.parametrize(
    "effect", [CameraDrift(0.1, 0.2), CameraRotation(1, 2, 3), CameraShift(), RadialDistortion(0.3)]
)
def test_projection_is_differentiable(effect, points):
    video, values = filmed().video, values_of(effect)

    def pixels(points, *numbers):
        return Observer([effect], dict(zip(values, numbers, strict=True))).project(points, video, 1, 2)[0]

    numbers = [value.requires_grad_() for value in values.values()]
    assert torch.autograd.gradcheck(pixels, (points[:5].requires_grad_(), *numbers))


def test_undistortion_is_differentiable():
    effect = RadialDistortion()
    observed = (torch.rand(8, 2, generator=torch.Generator().manual_seed(0)).double() - 0.5).requires_grad_()
    k1 = torch.tensor(-0.3, dtype=torch.float64, requires_grad=True)

    def ideal(observed, k1):
        return Observer([effect], {"k1": k1}).undistorted(observed, 3)

    # Newton's steps before the last one are not differentiated: exact at the solution
    assert torch.autograd.gradcheck(ideal, (observed, k1))


def test_time_and_colour_are_differentiable():
    video = filmed().video
    generator = torch.Generator().manual_seed(3)
    path, velocity = (torch.randn(*size, 3, generator=generator).double().requires_grad_() for size in ((4, 2), (2,)))
    for seconds in (-0.03, 0.03):
        offset = torch.tensor(seconds, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(
            lambda path, velocity, offset: Observer([TimeOffset()], {"time_offset": offset}).seen_by(
                3, path, velocity, video.times
            ),
            (path, velocity, offset),
        )
    gain = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    colour, light = path.detach()[0].requires_grad_(), double([0.2, 0.9])
    assert torch.autograd.gradcheck(
        lambda colour, gain: Observer([Exposure()], {"gain": gain}).colour(colour, light, video, 0, 0), (colour, gain)
    )


def test_two_cameras_can_be_wrong_in_the_same_way_and_one_only_once():
    model = Physics(NeoHookean(), effects=[CameraShift(0.01, view=3), CameraShift(view=5), CameraShift()])
    assert {"shift_x_view3", "shift_y_view5", "shift_x"} <= set(model.free_names)
    assert model.guess["shift_x_view3"] == 0.01
    assert model.parameters["shift_x_view3"].label == "shift to the right of view 3"
    with pytest.raises(UserInputError, match="two parameters 'gain_view3'"):
        Physics(NeoHookean(), effects=[Exposure(view=3), Exposure(view=3)])
    with pytest.raises(UserInputError, match="gain_view3 = -1"):
        Exposure(-1.0, view=3)


@pytest.mark.parametrize("kind", EFFECTS)
def test_every_fault_says_what_a_diagnosis_needs_and_vanishes_at_its_null(kind, points):
    effect = kind(view=3)
    assert effect.signature and effect.separating_experiment and 2 <= len(effect.probes) <= 3
    assert effect.guess == effect.null and all(probe.keys() == effect.null.keys() for probe in effect.probes)
    assert all(
        low < v < high for p in effect.probes for n, v in p.items() for low, high in [effect.parameters[n].bounds]
    )
    path, times = points[None] * torch.arange(1, 5)[:, None, None], STEP * torch.arange(4, dtype=torch.float64)
    data, colour = filmed(), torch.rand(7, 3, dtype=torch.float64)
    null = {name: double(value) for name, value in effect.null.items()}
    observer = Observer([effect], null)
    torch.testing.assert_close(observer.seen(path, points / STEP, times)[-1], path)
    torch.testing.assert_close(observer.rays(data, 0, 3).directions, data.rays(0).directions)
    torch.testing.assert_close(observer.colour(colour, colour[:, 0], data.video, 0, 3), colour)
