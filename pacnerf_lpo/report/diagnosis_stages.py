"""What the page of a diagnosis shows in addition to the statistics: errors by frame, those of the null replicates, and
images of the model before and after.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.localising import excess, floor
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.identification.forward_model import MARGIN
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.report import wording
from pacnerf_lpo.report.page import plain, size_within

PICTURES = "pictures.npz"
LONGEST = 128
"""Longest side of a picture on the page [pixels]."""
BAND = (0.05, 0.95)


@dataclass(frozen=True)
class Stage:
    """The model as it stood at one time of the diagnosis.

    added: name of the effect that was added last; None: none was.
    removed: names of the effects that were left out again last.
    effects: all of its effects.
    known: every value [SI]
    residual: measured minus predicted [pixels, (V, F, 11)]
    comparison: whose replicates tell how large the residual may be.
    """

    added: str | None
    removed: tuple[str, ...]
    effects: tuple[Effect, ...]
    known: dict[str, float]
    residual: np.ndarray
    comparison: Comparison


def stages_of(rounds: Sequence[Round]) -> list[Stage]:
    """The run's own model, and the model after each accepted effect and after the removal of superfluous ones."""
    found = []
    added: str | None = None
    for done in rounds:
        comparison = done.comparison
        found.append(Stage(added, tuple(done.removed), done.effects, comparison.known, comparison.residual, comparison))
        added = None if done.accepted is None else done.accepted.name
    last = rounds[-1]
    if last.accepted is not None:
        again, effects = last.accepted, (*last.effects, last.candidate(last.accepted.name).effect)
        found.append(Stage(again.name, (), effects, again.known, again.residual, last.comparison))
    return found


def errors_of(problem: Problem, stage: Stage) -> dict[str, Any]:
    """Errors of a stage, and of its replicates, by view and frame [the problem's unit].

    Root mean squares over the silhouette moments and points, less the replicates' mean. The floor is the median
    replicate's; the band holds nine tenths of the replicates. Errors of points by row are in millimetres.
    """
    others = stage.comparison.errors.replicates
    count = len(others)
    bias = floor(stage.comparison)[0]
    unit = problem.unit[1]
    error = unit * (stage.residual - bias)[..., : len(KINDS)]
    alone = unit * (others - bias)[..., : len(KINDS)] * count / (count - 1)  # each relative to the mean of the others
    alone = np.where(np.isfinite(error), alone, np.nan)
    parts = {"fitted": problem.split.fitted, "held": problem.split.held}
    band = np.quantile(root_mean_square(alone, (1, 3)), BAND, axis=0)
    by_row, row_floor = root_mean_square(error, (1, 2)), np.median(root_mean_square(alone, (2, 3)), axis=0)
    views, millimetres = problem.views, 1000 * problem.pixel / unit
    return {
        "added": stage.added,
        "readable": _readable(stage),
        "error": {n: float(root_mean_square(error[part], (0, 1))) for n, part in parts.items()},
        "floor": {n: float(np.median(root_mean_square(alone[:, part], (1, 2)))) for n, part in parts.items()},
        "by_frame": plain(root_mean_square(error, (0, 2))),
        "band": plain(band),
        "by_view": plain(by_row[:views]),
        "view_floor": plain(row_floor[:views]),
        "by_point": plain(by_row[views:] * millimetres),
        "point_floor": plain(row_floor[views:] * millimetres),
        "excess": plain(excess(stage.residual, stage.comparison)[:views]),
    }


def _readable(stage: Stage) -> str:
    """What distinguishes a stage from the one before."""
    if stage.removed:
        return f"without {wording.together(stage.removed)}"
    return "as fitted" if stage.added is None else f"+ {wording.readable(stage.added)}"


def root_mean_square(values: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Over some axes, of the values that are there; NaN where there is none."""
    return np.asarray(np.ma.filled(np.sqrt(np.ma.masked_invalid(values**2).mean(axes)), np.nan))


def write_pictures(problem: Problem, rounds: Sequence[Round], folder: Path) -> None:
    """Write the measured images and the outlines of the first and of the last stage, at most 128 pixels large, as
    ``pictures.npz``: ``measured`` (V, F, h, w, 3), ``matte`` and ``models`` ([(S,) V, F, h, w]), all uint8; nothing
    where no camera looked.
    """
    if not problem.views:
        return
    found = stages_of(rounds)
    shown = found[:1] if len(found) == 1 else [found[0], found[-1]]
    videos = [part.recording.video for part in problem.parts((), {})]
    np.savez_compressed(
        folder / PICTURES,
        measured=_stacked([_small(video.images.numpy()) for video in videos]),
        matte=_stacked([_small(video.silhouettes.numpy()) for video in videos]),
        models=np.stack([_outlines(problem, stage) for stage in shown]),
    )


@torch.no_grad()
def _outlines(problem: Problem, stage: Stage) -> np.ndarray:
    """Opacity in every view and frame, small [(V, F, h, w), uint8]."""
    models = (part.model for part in problem.parts(stage.effects, stage.known))
    seen = (model.outlines(model.path(model.start), model.start) for model in models)
    return _stacked([_small(one[..., MARGIN:-MARGIN, MARGIN:-MARGIN].numpy()) for one in seen])


def _stacked(recordings: Sequence[np.ndarray]) -> np.ndarray:
    """Pictures of several recordings [(V, F, h, w[, 3]), uint8] as one; white where one has no frame or is smaller."""
    largest = np.max([one.shape[1:] for one in recordings], axis=0)
    white = 255 if recordings[0].ndim == 5 else 0
    missing = ([(0, 0), *((0, pixels) for pixels in largest - one.shape[1:])] for one in recordings)
    return np.concatenate([np.pad(*pair, constant_values=white) for pair in zip(recordings, missing, strict=True)])


def _small(values: np.ndarray) -> np.ndarray:
    """Images [0..1, (V, F, H, W[, 3])] as bytes, reduced to the size of the page."""
    size = size_within(LONGEST, values.shape[2], values.shape[3])
    views = []
    for view in values:
        whole = np.rint(view.clip(0, 1) * 255).astype(np.uint8)
        views.append([np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX)) for image in whole])
    return np.array(views)
