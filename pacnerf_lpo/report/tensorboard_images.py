"""Pictures and chart layout for TensorBoard, of a run and of its diagnosis."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.evaluation.prediction import predict
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.events import PhaseEvents
from pacnerf_lpo.report.residual_colours import comparison_panel, residual_colours

TITLE = "rendered | measured | residual (orange: model darker, blue: brighter)"
CELL = 14
"""Side of a cell of the view x frame picture [pixels]."""
GAP = 6


def log_evaluation(run: Run, results: Mapping[str, Any]) -> None:
    """Show what ``evaluate_run`` returned: image metrics, rendered and measured images, at the last step of a phase."""
    step = 0
    for stage, result in zip(run.stages, results["phases"], strict=True):
        with PhaseEvents(run.run_dir, stage.record.phase, step) as events:
            for views, metrics in (result.get("image_metrics") or {}).items():
                numbers = {f"{name} ({views} views)": value for name, value in (metrics or {}).items()}
                events.add_metrics({k: v for k, v in numbers.items() if isinstance(v, float)}, stage.record.steps)
            if "images" in result:
                _add_comparisons(events, run, stage)
            if stage is run.last:
                events.add_custom_scalars(scalar_layout(results))
        step += stage.record.steps


def _add_comparisons(events: PhaseEvents, run: Run, stage: Stage) -> None:
    """First, middle and last frame of the first training and the first test view: rendered, measured and residual."""
    video, images = run.data.video, predict(run, stage).images
    frames = sorted({0, images.shape[1] // 2, images.shape[1] - 1})
    for view in [*run.data.train[:1], *run.data.test[:1]]:
        for frame in frames:
            predicted = torch.from_numpy(images[view, frame].copy()).float() / 255
            tag = f"view {video.view_ids[view]}, frame {video.frame_ids[frame]}"
            panel = comparison_panel(predicted, video.images[view, frame])
            events.add_picture(f"{tag}: {TITLE}", panel, stage.record.steps)


def scalar_layout(results: Mapping[str, Any]) -> dict[str, Any]:
    """The page "custom scalars": a chart for each physical parameter, the initial velocity, and the image metrics, as
    ``SummaryWriter.add_custom_scalars`` takes it: chapter, chart, and patterns of the tags in it.
    """
    last = results["phases"][-1]["parameters"]
    parameters = {}
    for name in results["free"]:
        unit = last[name]["unit"]
        tag = f"{name} [{unit.replace('/', '|')}]"
        parameters[f"{last[name]['label']} {name} [{unit}]"] = ["Multiline", [f"physics/{re.escape(tag)}"]]
    parameters["initial velocity [m/s]"] = ["Multiline", [r"(velocity|physics)/v_[xyz].*"]]
    quality = {
        f"{metric}, {views} views": ["Multiline", [rf".*/{metric} \({views} views\)"]]
        for views in ("test", "train")
        for metric in ("psnr", "ssim")
    }
    return {"physical parameters": parameters, "image quality after each phase": quality}


def log_diagnosis(run_dir: Path) -> None:
    """Log ``RUN/diagnosis/diagnosis.json`` under ``diagnosis/``: scalars by added effect and by view (at the number of
    added effects), by frame (at the frame's index), and the view x frame map of the excess error before and after.
    """
    result = json.loads((run_dir / "diagnosis" / "diagnosis.json").read_text())
    unit = result["unit"]
    with PhaseEvents(run_dir, "diagnosis") as events:
        for number, stage in enumerate(result["stages"]):
            whole = {f"error, {part} data [{unit}]": value for part, value in stage["error"].items()}
            events.add_metrics(whole, number)
            for view, value in zip(result["views"], stage["by_view"], strict=True):
                if value is not None:
                    events.add_metrics({f"error by view/{view} [{unit}]": value}, number)
            for frame, value in enumerate(stage["by_frame"]):
                if value is not None:
                    events.add_metrics({f"error by frame/{number} {stage['readable']} [{unit}]": value}, frame)
        if result["views"]:
            events.add_picture("excess error, view by frame (above: before, below: after)", excess_picture(result), 0)


def excess_picture(result: Mapping[str, Any]) -> Tensor:
    """Excess error of the first and of the last stage as shades of orange [0..1, (H, W, 3)], on a common scale."""
    shown = result["stages"][:1] + result["stages"][1:][-1:]
    excess = np.nan_to_num(np.array([stage["excess"] for stage in shown], float))
    cells = np.sqrt(excess.clip(0.0)).astype(np.float32).repeat(CELL, 1).repeat(CELL, 2)
    rows = np.pad(cells, ((0, 0), (GAP, 0), (0, 0))).reshape(-1, cells.shape[2])[GAP:]
    return residual_colours(-torch.from_numpy(rows), float(cells.max()) or 1.0)
