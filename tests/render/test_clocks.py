"""Known offsets of cameras: what a view sees in each frame, and where it stood for frame 0."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.data.cameras import pixel_rays, project
from pacnerf_lpo.data.checks import check_offsets, check_velocity
from pacnerf_lpo.data.video_data import at_start
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.render.camera_faults import TimeOffset
from pacnerf_lpo.render.clocks import KnownOffset, cameras_of
from pacnerf_lpo.render.observation import Observer
from tests.render.test_observation import STEP, filmed

GRAVITY = torch.tensor([0.0, -9.8, 0.0], dtype=torch.float64)
VELOCITY = torch.tensor([0.4, -1.0, 0.2], dtype=torch.float64)
OFFSET = 0.3 * STEP


def falling(times: torch.Tensor) -> torch.Tensor:
    """One particle in free fall from frame 0 on [m, (F, 1, 3)]."""
    t = (times - filmed().video.times[0]).double()[:, None]
    return (t * VELOCITY + 0.5 * t**2 * GRAVITY)[:, None]


def test_a_view_sees_the_motion_at_its_own_time():
    """Free fall is exact; the other views see what they saw; nothing is to be identified."""
    video = replace(filmed().video, offsets=(0.0, OFFSET))
    late, times = video.view_ids[1], video.times.double()
    cameras = cameras_of((TimeOffset(0.01, view=late),), video)
    assert [type(camera) for camera in cameras] == [KnownOffset, TimeOffset]
    fault = {f"time_offset_view{late}": torch.tensor(0.01, dtype=torch.float64)}
    for faults, values, total in (((), {}, OFFSET), ((TimeOffset(0.01, view=late),), fault, OFFSET + 0.01)):
        observer = Observer(cameras_of(faults, video), values)
        seen = observer.seen(falling(times), VELOCITY, times)
        torch.testing.assert_close(seen[observer.clock(late)], falling(times + total))
        torch.testing.assert_close(seen[observer.clock(video.view_ids[0])], falling(times))
    assert Observer(cameras_of((), video)).names == [] and cameras_of((), filmed().video) == ()


def test_frame_0_is_seen_from_where_it_looks_as_if_taken_at_time_0():
    video = replace(filmed().video, offsets=(0.0, OFFSET))
    place = torch.tensor([[0.05, -0.02, -2.0]], dtype=torch.float64)
    moved = place + OFFSET * VELOCITY
    first = at_start(video, VELOCITY.tolist())
    shown = project(moved, video.intrinsics[1].double(), video.camera_to_world[1].double())
    torch.testing.assert_close(project(place, first.intrinsics[1].double(), first.camera_to_world[1].double()), shown)
    assert (first.camera_to_world[0] == video.camera_to_world[0]).all()
    assert at_start(filmed().video, VELOCITY.tolist()).camera_to_world is not None
    rays = pixel_rays(first.intrinsics[1], first.camera_to_world[1], *video.images.shape[2:4])
    assert (rays.directions == filmed().rays(1).directions).all()


def test_an_offset_is_one_number_per_view():
    def index(*offsets: float) -> SimpleNamespace:
        shots = {(3, frame): SimpleNamespace(offset=offset) for frame, offset in enumerate(offsets)}
        return SimpleNamespace(shots=shots, where=lambda view, frame: f"entry of view {view}")

    assert check_offsets(index(0.01, 0.01), [3], [0, 1], 0.04) == (0.01,)
    assert check_offsets(index(0.0, 0.0), [3], [0, 1], 0.04) == ()
    for wrong in ((0.01, 0.02), (0.05, 0.05)):
        with pytest.raises(UserInputError, match="'time_offset'"):
            check_offsets(index(*wrong), [3], [0, 1], 0.04)
    with pytest.raises(UserInputError, match=r"data\.velocity"):
        check_velocity([1.0, 2.0])
