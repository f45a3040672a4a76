"""The data behind the report's pictures and charts, small enough to travel inside the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensorboard.backend.event_processing.event_accumulator import SCALARS, EventAccumulator

from pacnerf_lpo.evaluation.prediction import Prediction, StateRenderer, read_prediction, to_bytes, visible_particles
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.events import FOLDER
from pacnerf_lpo.quantities import symbol
from pacnerf_lpo.report.page import atlas, atlas_columns, base64_array, plain, quantised, size_within
from pacnerf_lpo.report.residual_colours import residual_colours, residual_scale, signed_residual

IMAGE_BUDGET = 6_500_000
LADDER = ((256, 85), (192, 80), (128, 75), (96, 60))
LATER_STAGES = 2
"""Phases whose images go into the page in addition to the first one that moves: the last ones."""
RADIUS = 0.31
"""Of a particle, in voxels: neighbours touch and small gaps stay visible."""
MAX_PARTICLES = 10_000
MAX_POINTS = 400


def build_payload(run: Run, results: Mapping[str, Any]) -> dict[str, Any]:
    """Everything the page's scripts read, of a run and its ``results.json``; true parameters are drawn as lines."""
    video = run.data.video
    rms = {phase["stem"]: phase["images"]["rms"] for phase in results["phases"] if "images" in phase}
    until = run.stages[: run.stages.index(run.last) + 1]
    moving = [stage for stage in until if stage.moves and stage.stem in rms]
    stages = [*moving[:1], *moving[1:][-LATER_STAGES:]]
    last = stages[-1] if stages else run.last
    prediction = read_prediction(run, last)
    return {
        "views": [
            {"id": number, "set": "train" if i in run.data.train else "test"} for i, number in enumerate(video.view_ids)
        ],
        "frames": list(video.frame_ids),
        "times": [round(time, 5) for time in video.times.tolist()],
        "contact": results["contact"],
        "images": build_images(run, stages),
        "residuals": [{"label": stage.label, "rms": plain(np.array(rms[stage.stem]))} for stage in stages],
        "particles": build_particles(last, prediction),
        "curves": build_curves(read_curves(run.run_dir, run.stages), results),
    }


def build_images(run: Run, stages: list[Stage]) -> dict[str, Any]:
    """Measured, modelled and residual images of every view as atlases, reduced until they fit the budget."""
    video, predictions = run.data.video, [read_prediction(run, stage) for stage in stages]
    height, width = video.images.shape[2:4]
    views, scale = range(len(video.view_ids)), 1.0

    def left(prediction: Prediction, view: int) -> torch.Tensor:
        images = torch.from_numpy(prediction.images[view].astype(np.float32) / 255)
        return signed_residual(images, video.images[view])

    if stages:
        scale = residual_scale(torch.cat([left(predictions[-1], view).flatten() for view in views]))
    for longest, quality in LADDER:
        size = size_within(longest, height, width)
        small = partial(atlas, size=size, quality=quality)
        measured = [small(to_bytes(images)) for images in video.images]
        models = [[small(one.images[view]) for view in views] for one in predictions]
        residuals = [
            [small(to_bytes(residual_colours(left(one, view) * video.valid[view], scale))) for view in views]
            for one in predictions
        ]
        weight = sum(len(uri) for part in (measured, *models, *residuals) for uri in part)
        if weight <= IMAGE_BUDGET:
            break
    return {
        "width": size[0],
        "height": size[1],
        "columns": atlas_columns(video.images.shape[1]),
        "scale": scale,
        "stages": [stage.label for stage in stages],
        "measured": measured,
        "model": models,
        "residual": residuals,
    }


def build_particles(stage: Stage, prediction: Prediction) -> dict[str, Any]:
    """Positions at every frame (16 bit) and colours (8 bit) of at most 10,000 particles that can be seen."""
    visible = visible_particles(stage.state)
    colours = to_bytes(StateRenderer(stage.state).particle_colours())[visible]
    positions = np.asarray(prediction.positions)
    size = 2 * RADIUS * stage.state.spacing
    return {**moving_particles(positions[:, visible], colours, size), "of": positions.shape[1]}


def moving_particles(
    positions: np.ndarray, colours: np.ndarray, size: float, most: int = MAX_PARTICLES
) -> dict[str, Any]:
    """What ``viewer.js`` shows: positions at every frame [m, (F, N, 3)], in 16 bit, and colours [0..255, (N, 3), uint8]
    of at most so many particles; ``size``: diameter of one where all are shown [m]; fewer are larger.
    """
    chosen = np.random.default_rng(0).permutation(positions.shape[1])[:most]
    integers, lower, extent = quantised(positions[:, chosen])
    return {
        "count": len(chosen),
        "of": positions.shape[1],
        "frames": len(positions),
        "lower": lower,
        "extent": extent,
        "positions": base64_array(integers),
        "colours": base64_array(colours[chosen]),
        "radius": size / 2 * (positions.shape[1] / len(chosen)) ** (1 / 3),
    }


@dataclass
class Curve:
    """One logged scalar: for each phase that logged it, its label, the iterations within the phase, and the values."""

    unit: str
    parts: list[tuple[str, list[int], list[float]]] = field(default_factory=list)


def read_curves(run_dir: Path, stages: list[Stage]) -> dict[str, Curve]:
    """Every scalar of the run by its name without phase, such as ``loss`` or ``E``.

    A scalar is logged as ``<phase>/<name> [<unit>]`` at steps that go on from phase to phase; slashes in units are
    written as bars.
    """
    events = EventAccumulator(str(run_dir / FOLDER), size_guidance={SCALARS: 0})
    if (run_dir / FOLDER).is_dir():
        events.Reload()
    curves: dict[str, Curve] = {}
    first = 0
    for stage in stages:
        last = first + stage.record.steps
        for tag in events.Tags().get(SCALARS, []):
            role, (name, unit) = tag.split("/")[0], split_unit(tag.split("/")[-1])
            curve = curves.setdefault(name, Curve(unit))
            points = _thinned([(e.step - first, e.value) for e in events.Scalars(tag) if first <= e.step <= last])
            if points and stage.record.phase == role:
                curve.parts.append((stage.label, [p[0] for p in points], [p[1] for p in points]))
        first = last
    return curves


def split_unit(text: str) -> tuple[str, str]:
    """``E [Pa]`` to ``("E", "Pa")``; the unit is ``1`` where none is given."""
    name, _, unit = text.partition(" [")
    return name, unit.rstrip("]").replace("|", "/") or "1"


def _thinned(points: list[tuple[int, float]]) -> list[tuple[int, float]]:
    stride = -(-len(points) // MAX_POINTS) if points else 1
    return points[::stride] + ([points[-1]] if points and (len(points) - 1) % stride else [])


def with_weighted_fits(curves: Mapping[str, Curve], phases: Sequence[Mapping[str, Any]]) -> dict[str, Curve]:
    """The curves of parameters and velocity, each phase followed by what the weighted fit after it has found, if there
    was one: a level as long as a tenth of the phase.
    """
    ends: dict[str, dict[str, float]] = {}
    for phase in phases:
        if "before" in phase:
            velocity = zip(("v_x", "v_y", "v_z"), phase["velocity"], strict=True)
            ends[phase["label"]] = {**dict(velocity), **{n: one["value"] for n, one in phase["parameters"].items()}}
    found: dict[str, Curve] = {}
    for name, curve in curves.items():
        found[name] = Curve(curve.unit)
        for label, steps, points in curve.parts:
            found[name].parts.append((label, steps, points))
            if name in ends.get(label, {}):
                found[name].parts.append(("weighted fit", [0, max(1, steps[-1] // 10)], [ends[label][name]] * 2))
    return found


def build_curves(curves: Mapping[str, Curve], results: Mapping[str, Any]) -> dict[str, Any]:
    """Losses, one chart per phase; identified parameters, one chart each; the initial velocity."""
    loss, truth = curves.get("loss", Curve("1")), results.get("truth_errors") or {}
    curves = with_weighted_fits(curves, results["phases"])
    parameters = [
        {
            "title": symbol(name),
            "unit": curves[name].unit,
            "log": curves[name].unit.startswith("Pa"),
            "truth": truth[name]["true"] if name in truth else None,
            "lines": [{"label": symbol(name), "parts": curves[name].parts}],
        }
        for name in results["free"]
        if name in curves
    ]
    velocity = [{"label": axis, "parts": curves[f"v_{axis}"].parts} for axis in "xyz" if f"v_{axis}" in curves]
    if velocity:
        parameters.append({"title": "initial velocity", "unit": "m/s", "log": False, "truth": None, "lines": velocity})
    losses = [{"title": part[0], "log": True, "lines": [{"label": "loss", "parts": [part]}]} for part in loss.parts]
    return {"loss": losses, "parameters": parameters}
