"""What a run says it will take, against what is there and what it does."""

from __future__ import annotations

import math
import re

import pytest
import torch

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm.materials import Auto, NeoHookean, Newtonian, VonMises
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases import estimate as module
from pacnerf_lpo.phases.estimate import estimate
from pacnerf_lpo.phases.identification_methods import GaussNewton, PaperAdam
from pacnerf_lpo.phases.law_choice import LawChoice
from pacnerf_lpo.phases.outline_method import OutlineGaussNewton
from pacnerf_lpo.phases.physics_id import PhysicsIDModule
from pacnerf_lpo.phases.schedules import Constant, TrainingLength
from pacnerf_lpo.phases.static_grid import StaticGridModule
from pacnerf_lpo.phases.velocity import VelocityModule


@pytest.fixture(scope="module")
def data() -> VideoData:
    box = ([-0.6, 0.2, -0.4], [0.6, 1.0, 0.4])
    return VideoData("asset:bird", *box, train_views=[0, 4, 8], image_scale=0.25, fit_box=True).prepare()


def static(steps: int = 100) -> StaticGridModule:
    return StaticGridModule(0.12, 1e-3, 1e-3, Constant(), Constant(), TrainingLength(steps, [20], 1), rays_per_step=256)


def physics() -> Physics:
    return Physics(NeoHookean(E=1e4, nu=0.1), substep_rate=480.0)


def test_line(data: VideoData, small_threads: None):
    (line,) = estimate([static(), VelocityModule(7)], static(), data, physics())
    found = re.fullmatch(r"about ([\d,]+) particles, about ([\d.]+) GiB of memory, about (.+) on this machine.*", line)
    assert found is not None and re.match("[0-9.]+ (minutes|hours)|a minute", found[3]) and 0.1 < float(found[2]) < 8
    bird, (lower, upper) = float(found[1].replace(",", "")), (data.box.lower, data.box.upper)
    box = 8 * math.prod(high - low for low, high in zip(lower, upper, strict=True)) / 0.06**3
    assert 0.1 * box < bird < box


def test_minutes_are_counted_times_measured(data: VideoData, small_threads: None, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_timed", lambda once: module.SAMPLE * 1e-3)
    (line,) = estimate([static(steps=1200)], static(), data, physics())  # 1200 steps of 256 rays, 1 ms each
    assert "about 5 minutes on this machine" in line


@pytest.mark.parametrize("method", [PaperAdam(), GaussNewton(), OutlineGaussNewton()], ids=lambda m: type(m).__name__)
def test_work_grows_with_frames_and_ends_without_search(data: VideoData, method):
    def frames(chosen) -> float:
        phase = PhysicsIDModule(7, chosen)
        phase.attach(data, physics())
        return phase.work(4000).frames

    assert frames(method) > 10 * len(data.video.times)
    if isinstance(method, OutlineGaussNewton):
        assert frames(OutlineGaussNewton(samples=0)) < frames(method)


def test_every_law_that_competes_is_counted(data: VideoData):
    def frames(laws) -> float:
        phase = LawChoice()
        phase.attach(data, Physics(Auto(laws), substep_rate=480.0))
        return phase.work(4000).frames

    two, three = frames([NeoHookean(), Newtonian()]), frames([NeoHookean(), Newtonian(), VonMises()])
    assert three > 1.1 * two  # what the best law may leave is counted once
    assert frames(None) == pytest.approx(two + (len(Auto().laws) - 2) * (three - two))


def test_an_unstable_guess_is_said(data: VideoData, monkeypatch: pytest.MonkeyPatch, small_threads: None):
    def unstable(*_) -> torch.Tensor:
        raise SimulationError(0, 1, "too stiff")

    monkeypatch.setattr(Physics, "motion", unstable)
    (line,) = estimate([VelocityModule(7)], static(), data, physics())
    assert line.endswith("how long it takes is not known: the guess of the material is unstable at this time step")
