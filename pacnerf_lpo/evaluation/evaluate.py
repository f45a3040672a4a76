"""Image quality and parameter errors of every phase of a run: ``results.json``."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from tqdm import tqdm

from pacnerf_lpo.data.assets import demo_scene
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.evaluation.doubts import doubts_of_run
from pacnerf_lpo.evaluation.image_metrics import ImageScores, Missing, image_scores, mean_squared_error
from pacnerf_lpo.evaluation.parameter_errors import Truth, parameter_errors, read_truth
from pacnerf_lpo.evaluation.prediction import contact_of, render_stage
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.evaluation.tables import result_phase
from pacnerf_lpo.manifest import INTERVALS_FILE, write_atomically

RESULTS_FILE = "results.json"
DEMO_TRUTH = "demo"


def evaluate_run(run_dir: str | Path, truth: str | Path | None = None) -> dict[str, Any]:
    """Measure every finished phase of a run on its training and test views, and write ``results.json``. Raises
    UserInputError where the run or the truth cannot be read.

    Each phase is simulated and rendered into every view; the static phase at frame 0 only. No truth is opened unless it
    is given: a truth.json, or ``demo`` for that of the shipped scene. Returns what was written.
    """
    run = Run(run_dir)
    answer = None if truth is None else read_truth(demo_scene() / "truth.json" if str(truth) == DEMO_TRUTH else truth)
    video = run.data.video
    results: dict[str, Any] = {
        "format": 1,
        "scene": run.scene,
        "material": type(run.physics.material).__name__,
        "views": {name: [video.view_ids[i] for i in views] for name, views in _view_sets(run).items()},
        "frames": list(video.frame_ids),
        "times_s": video.times.tolist(),
        "guess": _with_units(run, run.physics.guess),
        "free": list(run.physics.free_names),
        "density_kg_m3": run.physics.rho,
        "ground": type(run.physics.ground).__name__,
        "effects": [type(effect).__name__ for effect in run.physics.effects],
        "laws": run.laws,
        "phases": [_evaluate_stage(run, stage, answer) for stage in run.stages],
        "result": run.last.stem,
        "chosen_round": run.manifest.chosen_round,
    }
    counted = run.stages[: run.stages.index(run.last) + 1]
    failed = {phase["stem"] for phase in results["phases"] if "error" in phase}
    moving = [stage for stage in counted if stage.moves and stage.stem not in failed]
    results["contact"] = contact_of(run, moving[-1]) if moving else None
    intervals = run.run_dir / INTERVALS_FILE
    if intervals.is_file():
        results["intervals"] = json.loads(intervals.read_text())
    results["doubts"] = [asdict(doubt) for doubt in doubts_of_run(run.data, run.physics, counted, results)]
    if answer is not None:
        results["truth_errors"] = result_phase(results)["truth_errors"]
        results["hidden_effects"] = answer.hidden_effects
    write_atomically(run.run_dir / RESULTS_FILE, json.dumps(results, indent=1, allow_nan=False).encode())
    return results


def _evaluate_stage(run: Run, stage: Stage, truth: Truth | None) -> dict[str, Any]:
    state, record = stage.state, stage.record
    velocity = state.velocity.mean(0).tolist()
    parameters = {**run.physics.guess, **state.physics}
    result: dict[str, Any] = {
        "stem": stage.stem,
        "label": stage.label,
        "round": record.round,
        "phase": record.phase,
        "seconds": record.seconds,
        "steps": record.steps,
        "particles": len(state.positions),
        "spacing_m": state.spacing,
        "parameters": _with_units(run, parameters),
        "velocity": velocity,
    }
    methods = None if "error" in (record.methods or {}) else record.methods
    further = {"before": record.before, "methods": methods, "held_out_error": record.held_out_error}
    result |= {name: value for name, value in further.items() if value is not None}
    if truth is not None:
        mu = run.physics.parameters.get("mu")
        errors = parameter_errors(parameters, truth, fluid=mu is not None and "s" in mu.unit)  # then mu is a viscosity
        result["truth_errors"] = {name: asdict(error) for name, error in errors.items()}
        if truth.velocity is not None and stage.moves:
            error = math.dist(velocity, truth.velocity)
            result["velocity_error"] = {"true": list(truth.velocity), "error": error, "unit": "m/s"}
    try:
        return {**result, **_measure_images(run, stage)}
    except SimulationError as error:
        return {**result, "error": str(error)}


def _measure_images(run: Run, stage: Stage) -> dict[str, Any]:
    """Metrics of a phase: means over training and test views, of all frames and of the first, and image by image."""
    video = run.data.video
    frames = len(video.times) if stage.moves else 1
    shape = (len(video.view_ids), frames)
    table = {name: torch.zeros(shape) for name in ("psnr", "ssim", "lpips", "rms", "blank_rms", "silhouette_iou")}
    missing: Missing | None = None
    rendered = render_stage(run, stage)
    bar = tqdm(rendered, f"evaluating {stage.label}", shape[0] * frames, delay=2.0, leave=False)
    for frame, view, image, opacity in bar:
        measured, valid = video.images[view, frame][None], video.valid[view]
        predicted = torch.where(valid[None, ..., None], image[None], measured)  # what an occluder hides counts as equal
        scores = image_scores(predicted, measured)
        silhouettes = (opacity > 0.5) & valid, (video.silhouettes[view, frame] > 0.5) & valid
        table["psnr"][view, frame] = scores.psnr[0]
        table["ssim"][view, frame] = scores.ssim[0]
        table["rms"][view, frame] = mean_squared_error(predicted, measured)[0].sqrt()
        table["blank_rms"][view, frame] = mean_squared_error(torch.ones_like(measured), measured)[0].sqrt()
        table["silhouette_iou"][view, frame] = intersection_over_union(*silhouettes)
        if isinstance(scores.lpips, Missing):
            missing = scores.lpips
        else:
            table["lpips"][view, frame] = scores.lpips[0]
    scores_all = ImageScores(table["psnr"], table["ssim"], missing or table["lpips"])
    if missing is not None:
        del table["lpips"]
    return {
        "image_metrics": _by_set(run, scores_all, frames) if stage.moves else {"train": None, "test": None},
        "first_frame_metrics": _by_set(run, scores_all, 1),
        "images": {
            name: [[value if math.isfinite(value) else None for value in row] for row in values.tolist()]
            for name, values in table.items()
        },
    }


def intersection_over_union(one: Tensor, other: Tensor) -> Tensor:
    """Overlap of two boolean masks, 1 where both are empty."""
    union = (one | other).sum()
    return torch.where(union > 0, (one & other).sum() / union.clamp_min(1), torch.ones(()))


def _with_units(run: Run, values: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    described = run.physics.parameters
    return {
        name: {"value": value, "unit": described[name].unit, "label": described[name].label}
        for name, value in values.items()
    }


def _by_set(run: Run, scores: ImageScores, frames: int) -> dict[str, dict[str, Any] | None]:
    """Means over training and over test views of the first so many frames; None where there is no such view."""
    sets = _view_sets(run).items()
    return {name: scores.mean((views, slice(frames))) if views else None for name, views in sets}


def _view_sets(run: Run) -> dict[str, list[int]]:
    return {"train": run.data.train, "test": run.data.test}
