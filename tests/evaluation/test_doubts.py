"""Each doubt, planted, is named with cause and remedy; a clean run raises none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pacnerf_lpo.evaluation.doubts import Doubt, doubts_of_phase, doubts_of_run
from pacnerf_lpo.evaluation.doubts.identification import (
    doubts_about_identification,
    doubts_about_intervals,
    doubts_about_methods,
    doubts_about_parameters,
    doubts_about_velocity,
)
from pacnerf_lpo.evaluation.doubts.images import doubts_about_images
from pacnerf_lpo.evaluation.doubts.recording import measure_fall
from pacnerf_lpo.manifest import PhaseRecord
from pacnerf_lpo.mpm.effects import GroundFriction
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import ParticleState, Video
from tests.data.recordings import studio

SPACING = 0.03


@cache
def ball_data(views: int = studio.VIEWS, frames: int = studio.FRAMES, block: int = 1) -> SimpleNamespace:
    """A ball that lands and flattens, filmed by some views; ``block`` makes its images smaller."""
    opacity = torch.from_numpy(studio.films(off_centre=False)[:views, :frames, ..., 3]).float()
    small = torch.nn.functional.avg_pool2d(opacity, block)
    intrinsic = torch.from_numpy(studio.centred()).float()
    intrinsic[:2] /= block
    video = Video(
        images=(1 - small)[..., None].expand(*small.shape, 3),
        silhouettes=small,
        valid=torch.ones(views, *small.shape[2:], dtype=torch.bool),
        camera_to_world=torch.from_numpy(studio.rig()[:views]).float(),
        intrinsics=intrinsic.expand(views, 3, 3),
        times=torch.arange(frames) / studio.FPS,
        view_ids=tuple(range(views)),
        frame_ids=tuple(range(frames)),
    )
    return SimpleNamespace(video=video, train=list(range(views)), test=[])


def ball_state(spacing: float = SPACING, **physics: float) -> ParticleState:
    axis = torch.arange(-studio.RADIUS, studio.RADIUS, spacing / 2)
    points = torch.cartesian_prod(axis, axis, axis)
    points = points[points.norm(dim=1) < studio.RADIUS] + torch.tensor(studio.START).float()
    count = len(points)
    return ParticleState(
        positions=points,
        velocity=torch.tensor(studio.VELOCITY).float().expand(count, 3),
        density=torch.full((count,), 80.0),
        features=torch.zeros(count, 12),
        physics={"E": 1e5, "nu": 0.3, "ground_height": 0.0, **physics},
        spacing=spacing,
        base_spacing=spacing,
    )


def stage(phase: str, state: ParticleState, **course: object) -> SimpleNamespace:
    record = PhaseRecord(0, 0, phase, "done", "", f"states/{phase}.pt", course=dict(course))
    return SimpleNamespace(state=state, record=record, run_dir=Path())


def model(**more: object) -> Physics:
    return Physics(NeoHookean(E=3e4, nu=0.3), fit_ground_height=True, **more)


def identification(**changes: object) -> dict:
    """The course of an identification that went well."""
    fell = [0.01 * 0.7**k + 0.002 for k in range(12)]
    moved = [4.5 + 0.5 * (1 - 0.4**k) for k in range(13)]
    course = {
        "method": "GaussNewton",
        "hit_frame": studio.CONTACT,
        "draws_views": False,
        "converged": True,
        "searched": {"E": (1.5, 7.5)},
        "costs": fell,
        "visited": {"E": moved, "nu": [0.3] * 13},
    }
    return {**course, **changes}


def names(doubts: Iterable[Doubt]) -> list[str]:
    found = []
    for doubt in doubts:
        assert "\n" not in str(doubt) and all((doubt.where, doubt.what, doubt.cause, doubt.remedy))
        found.append(doubt.name)
    return found


def test_a_clean_run_raises_no_doubt():
    data, state = ball_data(), ball_state()
    course = identification()
    velocity = stage("velocity", state, frames=studio.CONTACT, last_step=1e-4)
    for one in (stage("static", state), velocity, stage("physics", state, **course), stage("correction", state)):
        assert names(doubts_of_phase(data, model(), one)) == []


def test_too_few_views():
    assert names(doubts_of_phase(ball_data(views=2), model(), stage("static", ball_state()))) == ["few_views"]


@pytest.mark.parametrize(
    ("block", "spacing", "expected"),
    [(4, 0.12 / 2, ["few_pixels"]), (2, 0.012, ["fine_voxels"]), (1, 0.09, ["coarse_voxels"])],
)
def test_too_few_pixels_or_voxels(block: int, spacing: float, expected: list[str]):
    """The ball is about 35 pixels across; a block of 4 leaves 9."""
    found = names(doubts_of_phase(ball_data(block=block), model(), stage("static", ball_state(spacing))))
    assert [name for name in found if name in expected] == expected
    assert "few_views" not in found


def test_the_fall_is_measured_by_the_outlines():
    fall = measure_fall(ball_data())
    assert fall is not None and fall.contact == studio.CONTACT
    assert abs(fall.ground) < fall.error


@pytest.mark.parametrize(("ground", "expected"), [(0.0, []), (0.15, ["ground"]), (-0.15, ["ground"])])
def test_a_ground_that_the_outlines_contradict(ground: float, expected: list[str]):
    one = stage("velocity", ball_state(), frames=studio.CONTACT)
    assert names(doubts_of_phase(ball_data(), model(ground_height=ground), one)) == expected


@pytest.mark.parametrize(
    ("frames", "hit_frame", "expected"),
    [
        (studio.CONTACT - 1, 3, ["no_contact"]),
        (studio.CONTACT + 2, studio.CONTACT, ["short_contact"]),
        (studio.FRAMES, studio.CONTACT - 3, ["contact_frame"]),
    ],
)
def test_a_contact_that_is_missing_too_short_or_elsewhere(frames: int, hit_frame: int, expected: list[str]):
    one = stage("velocity", ball_state(), frames=hit_frame)
    assert names(doubts_of_phase(ball_data(frames=frames), model(), one)) == expected


def test_a_velocity_that_still_moved():
    state = ball_state()
    assert names(doubts_about_velocity({"last_step": 0.2}, state, 0.01, 0.25)) == ["velocity_moving"]  # 5 cm
    assert list(doubts_about_velocity({"last_step": 0.03}, state, 0.01, 0.25)) == []  # 8 mm of a pixel of 10


def test_a_velocity_that_the_identification_fitted_again_is_no_doubt():
    state, results = ball_state(), {"phases": []}
    moving = stage("velocity", state, frames=studio.CONTACT, last_step=0.5)
    for again, expected in ((False, ["velocity_moving"]), (True, [])):
        fitted = stage("physics", state, **identification(fits_velocity=again))
        assert names(doubts_of_run(ball_data(), model(), [moving, fitted], results)) == expected


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, []),
        ({"nu": -0.05}, ["negative_poisson"]),
        ({"nu": 0.448}, ["material_bound"]),
        ({"E": 5e11}, ["search_bound"]),
        ({"E": 9.5e11}, ["material_bound"]),
        ({"E": 35.0}, ["search_bound"]),
        ({"ground_height": 0.02}, ["ground_moved"]),
    ],
)
def test_parameters_at_their_bounds(values: dict, expected: list[str]):
    found = list(doubts_about_parameters(model(), ball_state(**values), {"E": (1.5, 7.5)}))
    assert names(found) == expected


@pytest.mark.parametrize(("error", "expected"), [(0.004, ["ground_moved"]), (0.012, [])])
def test_a_ground_that_was_measured_may_be_as_far_off_as_that(error: float, expected: list[str]):
    found = list(doubts_about_parameters(model(ground_error=error), ball_state(ground_height=0.02), {}))
    assert names(found) == expected
    assert all("and the error of its measurement (4 mm)" in one.what for one in found)


@pytest.mark.parametrize(("friction", "expected"), [(0.5, []), (0.02, ["material_bound"]), (None, [])])
def test_an_effect_is_at_its_bound_only_where_it_does_not_vanish(friction: float | None, expected: list[str]):
    effect = GroundFriction(0.5)
    value = effect.null["ground_friction"] if friction is None else friction
    found = list(doubts_about_parameters(model(effects=[effect]), ball_state(ground_friction=value), {}))
    assert [name for name in names(found) if name != "far_from_prior"] == expected


@pytest.mark.parametrize(
    ("low", "high", "determined", "expected"),
    [
        (9e4, 1.1e5, True, []),
        (1.05e5, 1.1e5, True, ["outside_interval"]),
        (1.05e5, 1.1e5, False, []),
    ],
)
def test_an_interval_that_leaves_out_what_the_identification_had(
    low: float, high: float, determined: bool, expected: list[str]
):
    nu = {"value": 0.1, "low": 0.0, "high": 0.2, "determined": determined}
    parameters = {"E": {"value": 1.07e5, "low": low, "high": high, "determined": determined}, "nu": nu}
    found = list(doubts_about_intervals(model(), {"E": 1e5, "nu": 0.1}, {"parameters": parameters}))
    assert names(found) == expected
    assert all(one.what.endswith("had E = 100 kPa (interval 105 kPa to 110 kPa)") for one in found)
    both = list(doubts_about_intervals(model(), {"E": 2e5, "nu": 0.3}, {"parameters": parameters}))
    assert names(both) == ["outside_interval"] * determined
    assert all("E = 200 kPa" in one.what and "= 0.3 (interval" in one.what for one in both)
    nu["with_solver"] = [-0.1, 0.4]  # which leaves out what the solver alone would
    assert all(
        "0.3 (interval" not in one.what
        for one in doubts_about_intervals(model(), {"E": 2e5, "nu": 0.3}, {"parameters": parameters})
    )


@pytest.mark.parametrize(("value", "expected"), [(1.5e5, []), (1.7e5, ["outside_interval"])])
def test_a_fit_of_equal_weights_may_be_farther_away(value: float, expected: list[str]):
    interval = {"value": 1.07e5, "low": 9e4, "high": 1.1e5, "determined": True, "equal_weights": [7e4, 1.6e5]}
    found = list(doubts_about_intervals(model(), {"E": value}, {"parameters": {"E": interval}}))
    assert names(found) == expected


@pytest.mark.parametrize(("share", "expected"), [(0.002, []), (0.06, ["open_shape"])])
def test_what_no_outline_bounds_is_doubted(share: float, expected: list[str]):
    found = list(doubts_about_intervals(model(), {}, {"parameters": {}, "open_volume": share}))
    assert names(found) == expected
    assert all("6% of the body's volume" in one.what for one in found)


def test_intervals_of_a_fit_that_leaves_more_than_noise_are_doubted():
    for p_value, expected in ((0.2, []), (0.001, ["not_noise"])):
        fit = {"p_value": p_value, "parameters": {}}
        assert names(doubts_about_intervals(model(), {"E": 1e5}, fit)) == expected


def test_a_value_far_from_the_guess_where_nothing_was_searched():
    found = list(doubts_about_parameters(model(), ball_state(E=2e8), {}))  # 3.8 decades
    assert names(found) == ["far_from_prior"] and "3.8 standard deviations" in found[0].what


def test_an_identification_that_rose_or_left_its_best():
    physics = model()
    rose = identification(costs=[0.002, 0.0021, 0.004])
    assert names(doubts_about_identification(rose, physics)) == ["cost_rose"]
    left = identification(costs=[0.01, 0.002, 0.005])
    found = list(doubts_about_identification(left, physics))
    assert names(found) == ["cost_rose"] and "after 0.002 in iteration 2 of 3" in found[0].what


def test_how_an_identification_went_does_not_matter_once_the_weighted_fit_took_its_place():
    rose = identification(costs=[0.002, 0.0021, 0.004])
    for before, expected in ((None, ["cost_rose"]), ({"E": 9e4}, [])):
        one = stage("physics", ball_state(), **rose)
        one.record.before = before
        assert names(doubts_of_phase(ball_data(), model(), one)) == expected


def test_chance_in_the_choice_of_views_is_no_rise():
    """Adam draws a view for each frame: a hundred noisy costs without a trend rise by chance alone."""
    rng, physics = np.random.default_rng(0), model()
    flagged = 0
    for _ in range(100):
        course = identification(draws_views=True, costs=list(0.01 + 0.001 * rng.standard_normal(100)))
        flagged += len(list(doubts_about_identification(course, physics)))
    assert flagged <= 3  # three standard errors: once in 370 for the ends, more rarely for the best of all windows
    noise = 0.001 * rng.standard_normal(100)
    risen = identification(draws_views=True, costs=list(np.linspace(0.01, 0.015, 100) + noise))
    assert names(doubts_about_identification(risen, physics)) == ["cost_rose"]


def test_an_identification_that_ran_out_of_steps():
    moving = identification(converged=False, visited={"E": [4.0, 4.2, 4.4, 4.6, 4.8, 5.0], "nu": [0.3] * 6})
    found = list(doubts_about_identification(moving, model()))
    assert names(found) == ["still_moving"] and "a factor of 2.5 in the last of 5 iterations" in found[0].what
    assert list(doubts_about_identification({**moving, "converged": True}, model())) == []


def test_methods_that_differ_are_reported_with_their_numbers():
    methods = {
        "particles": 1500,
        "images": {"E": 1.02e5, "nu": 0.3, "ground_height": 0.0},
        "outlines": {"E": 3.85e5, "nu": 0.34, "ground_height": 0.01},
        "excess": {"images": 12.0, "outlines": 80.0},
    }
    found = list(doubts_about_methods(methods, model()))
    assert names(found) == ["methods_differ"]
    assert "images give 1.02e+05 Pa and outlines 3.85e+05 Pa" in found[0].what
    assert list(doubts_about_methods({**methods, "outlines": methods["images"]}, model())) == []
    assert list(doubts_about_methods({"error": "unstable"}, model())) == []
    assert list(doubts_about_methods(None, model())) == []


def test_images_that_stand_out():
    def doubts(train: float, test: float, after: float = 1.0, second: float = 1.0) -> list[str]:
        rms = np.array([[train] * 6, [second * train] * 6, [test] * 6])
        rms[:, 3:] *= after
        results = {"views": {"train": [0, 4], "test": [7]}, "contact": 3}
        return names(doubts_about_images(results, {"images": {"rms": rms.tolist()}}))

    assert doubts(0.02, 0.02) == []
    assert doubts(0.01, 0.05) == ["held_out_views"]
    assert doubts(0.02, 0.02, after=3.0) == ["after_contact"]
    assert doubts(0.02, 0.02, second=3.0) == ["one_view"]


def test_a_state_without_identification_is_not_judged_by_it():
    state = replace(ball_state(), physics={})
    assert list(doubts_of_phase(ball_data(), model(), stage("physics", state))) == []
