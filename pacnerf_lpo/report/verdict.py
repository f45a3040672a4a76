"""What the numbers of a run say, in sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

GOOD, FAIR = 0.75, 0.5
"""Overlap (intersection over union) from which an outline counts as found closely, and as found: the strict threshold
of COCO (Lin et al., ECCV 2014), and that of PASCAL VOC (Everingham et al., IJCV 2010)."""


@dataclass(frozen=True)
class Verdict:
    """How well the model shows the video.

    grade: ``good``, ``fair`` or ``poor``.
    headline: one sentence.
    """

    grade: str
    headline: str


def explained(phase: Mapping[str, Any], rows: Sequence[int]) -> float:
    """Share of the image the model accounts for: 1 - sum of squared residuals / that of an empty scene."""
    residual = np.square(np.array(phase["images"]["rms"])[list(rows)]).sum()
    blank = np.square(np.array(phase["images"]["blank_rms"])[list(rows)]).sum()
    return float(1 - residual / max(blank, 1e-12))


def judge(results: Mapping[str, Any], phase: Mapping[str, Any]) -> Verdict:
    """Judge the last phase of evaluated results, which has images.

    By the overlap of the silhouettes in the frame in which it is least, a mean over the views held out, or over the
    training views where none is: ``good`` from GOOD on, ``fair`` from FAIR on. A model that is farther from the video
    than an empty scene is ``poor``.
    """
    order = sorted([*results["views"]["train"], *results["views"]["test"]])
    train = [order.index(view) for view in results["views"]["train"]]
    test = [order.index(view) for view in results["views"]["test"]]
    judged = test or train
    share = explained(phase, judged)
    overlap = np.array(phase["images"]["silhouette_iou"])[judged].mean(0)
    worst = float(overlap.min())
    grade = "poor" if share <= 0 or worst < FAIR else "fair" if worst < GOOD else "good"
    whose = f"{len(test)} views it never saw" if test else f"the {len(train)} training views (none was held out)"
    headline = (
        f"The model explains {100 * share:.1f} % of the image in {whose}; silhouettes overlap by "
        f"{100 * overlap.mean():.0f} %, in the worst frame by {100 * worst:.0f} %."
        if share > 0
        else f"In {whose} the model is farther from the video than an empty scene is."
    )
    return Verdict(grade, headline)
