"""What the numbers of a run say, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

GOOD, FAIR = 0.98, 0.90
"""Shares of the image explained."""
LAG = 2.0
CONTACT_GROWTH = 1.8


@dataclass(frozen=True)
class Verdict:
    """How well the model shows the video.

    grade: ``good``, ``fair`` or ``poor``.
    headline: one sentence.
    remarks: what a person should look at, most important first.
    """

    grade: str
    headline: str
    remarks: tuple[str, ...]


def explained(phase: Mapping[str, Any], rows: Sequence[int]) -> float:
    """Share of the image the model accounts for: 1 - sum of squared residuals / that of an empty scene."""
    residual = np.square(np.array(phase["images"]["rms"])[list(rows)]).sum()
    blank = np.square(np.array(phase["images"]["blank_rms"])[list(rows)]).sum()
    return float(1 - residual / max(blank, 1e-12))


def judge(results: Mapping[str, Any], phase: Mapping[str, Any], contact: int | None) -> Verdict:
    """Judge the last phase.

    By the share of the squared image content that is explained in the views held out, in the training views where none
    is: ``good`` from GOOD on, ``fair`` from FAIR on.

    Args:
        results: of :func:`pacnerf_lpo.evaluation.evaluate.evaluate_run`.
        phase: the entry of ``results["phases"]`` to judge, with images.
        contact: first frame in which the body is at the ground, None when it never is.
    """
    order = sorted([*results["views"]["train"], *results["views"]["test"]])
    train = [order.index(view) for view in results["views"]["train"]]
    test = [order.index(view) for view in results["views"]["test"]]
    judged = test or train
    share = explained(phase, judged)
    grade = "good" if share >= GOOD else "fair" if share >= FAIR else "poor"
    overlap = np.array(phase["images"]["silhouette_iou"])[judged].mean()
    whose = f"{len(test)} views it never saw" if test else f"the {len(train)} training views (none was held out)"
    headline = (
        f"The model explains {100 * share:.1f} % of the image in {whose}; silhouettes overlap by {100 * overlap:.0f} %."
        if share > 0
        else f"In {whose} the model is farther from the video than an empty scene is."
    )
    return Verdict(grade, headline, tuple(_remarks(phase, order, train, test, contact)))


def _remarks(
    phase: Mapping[str, Any], order: list[int], train: list[int], test: list[int], contact: int | None
) -> list[str]:
    rms = np.array(phase["images"]["rms"])
    found = []
    if test and _mean(rms[test]) > LAG * _mean(rms[train]):
        times = _mean(rms[test]) / _mean(rms[train])
        found.append(
            f"Residuals in held-out views are {times:.1f} times those in training views: "
            "the shape is a guess where no camera looked."
        )
    if contact is not None and 0 < contact < rms.shape[1]:
        before, after = _mean(rms[:, :contact]), _mean(rms[:, contact:])
        if after > CONTACT_GROWTH * before:
            found.append(
                f"From contact on (frame {contact}) residuals are {after / before:.1f} times those in free fall: "
                "look at the material and the ground."
            )
    worst = int(rms.mean(1).argmax())
    others = np.delete(rms, worst, axis=0)
    if len(rms) > 2 and _mean(rms[worst]) > LAG * _mean(others) and worst in train:
        found.append(f"Training view {order[worst]} stands out from all others: check its camera.")
    return found


def _mean(rms: np.ndarray) -> float:
    return float(np.sqrt(np.square(rms).mean()))
