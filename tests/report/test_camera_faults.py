"""Predicted images are seen through the cameras as they were found to be."""

from __future__ import annotations

from pathlib import Path

import torch
import yaml

from pacnerf_lpo.evaluation.prediction import render_stage
from pacnerf_lpo.evaluation.run_directory import Run
from tests.report.example_run import write_example_run

GAIN, SHIFT = 0.5, 0.05


def faulty_run(folder: Path) -> Run:
    """The example run with two wrong cameras (file ids 4 and 8), whose faults the physical phases have found."""
    write_example_run(folder, frames=2)
    config = yaml.safe_load((folder / "config.yaml").read_text())
    config["physics"]["effects"] = [
        {"class_path": "pacnerf_lpo.render.camera_faults.Exposure", "init_args": {"gain": GAIN, "view": 4}},
        {"class_path": "pacnerf_lpo.render.camera_faults.CameraShift", "init_args": {"shift_x": SHIFT, "view": 8}},
    ]
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return Run(folder)


def test_only_the_wrong_cameras_see_something_else(tmp_path: Path, example_motion: None):
    plain, faulty = Run(write_example_run(tmp_path / "plain", frames=2)), faulty_run(tmp_path / "faulty")
    assert plain.data.video.view_ids == (0, 2, 4, 8)
    for expected, found in zip(render_stage(plain, plain.last), render_stage(faulty, faulty.last), strict=True):
        (_, view, image, opacity), (_, _, other, other_opacity) = expected, found
        if view < 2:
            assert torch.equal(image, other)
        elif view == 2:  # the object is darker, the white behind it is not
            white = 1 - opacity[..., None]
            torch.testing.assert_close(other, GAIN * (image - white) + white)
            assert torch.equal(opacity, other_opacity)
        else:  # the camera stands further right, so the object is seen further left, by f shift / z pixels
            columns = torch.arange(opacity.shape[1]) + 0.5
            left, right = ((o * columns).sum() / o.sum() for o in (other_opacity, opacity))
            focal = plain.data.video.intrinsics[3, 0, 0]
            depth = plain.data.video.camera_to_world[3, :, 3].norm()  # of the scene's middle, within a tenth or so
            assert 0.7 < (right - left) / (focal * SHIFT / depth) < 1.4


def test_the_static_phase_has_seen_nothing_of_it(tmp_path: Path, example_motion: None):
    faulty = faulty_run(tmp_path / "faulty")
    static = next(stage for stage in faulty.stages if not stage.moves)
    plain = Run(write_example_run(tmp_path / "plain", frames=2))
    for expected, found in zip(render_stage(plain, plain.stages[0]), render_stage(faulty, static), strict=True):
        assert torch.equal(expected[2], found[2])
