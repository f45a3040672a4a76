"""What TensorBoard shows of an evaluated run: panels under the phase's name, and charts that match logged tags."""

from __future__ import annotations

import io
import json
import re
import shutil

import numpy as np
import pytest
import torch
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.events import PhaseEvents
from pacnerf_lpo.report.residual_colours import NEGATIVE, comparison_panel
from pacnerf_lpo.report.tensorboard_images import TITLE, log_evaluation, scalar_layout


def events_of(folder) -> EventAccumulator:
    events = EventAccumulator(str(folder / "tensorboard"), size_guidance={"images": 0})
    events.Reload()
    return events


def test_panel_is_logged_under_the_phase_at_the_run_s_step(tmp_path):
    panel = comparison_panel(torch.zeros(8, 10, 3), torch.ones(8, 10, 3))
    with PhaseEvents(tmp_path, "physics", first_step=100) as writer:
        writer.add_picture(f"view 3: {TITLE}", panel, 7)
    events = events_of(tmp_path)
    (tag,) = events.Tags()["images"]
    assert tag.startswith("physics/view 3: rendered | measured | residual")
    (image,) = events.Images(tag)
    assert image.step == 107
    shown = np.asarray(Image.open(io.BytesIO(image.encoded_image_string)))
    assert shown.shape == (8, 30, 3)
    assert (shown[:, :10] == 0).all() and (shown[:, 10:20] == 255).all()
    assert shown[0, 25] == pytest.approx(np.array(NEGATIVE) * 255, abs=1)


def test_every_chart_of_the_layout_finds_its_scalars(evaluated_run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(evaluated_run, copy)
    results = json.loads((copy / "results.json").read_text())
    log_evaluation(Run(copy), results)
    events = events_of(copy)
    layout = scalar_layout(results)
    assert "Young's modulus E [Pa]" in layout["physical parameters"]
    for chapter in layout.values():
        for _, patterns in chapter.values():
            assert any(re.fullmatch(patterns[0], tag) for tag in events.Tags()["scalars"]), patterns
    assert "custom_scalars__config__" in events.Tags()["tensors"]
