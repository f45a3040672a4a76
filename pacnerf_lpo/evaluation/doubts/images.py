"""Doubts that the images of a model raise: where its residuals stand out."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pacnerf_lpo.evaluation.doubts.doubt import Doubt
from pacnerf_lpo.evaluation.tables import view_rows

LAG = 2.0
"""Of two root mean squares: three quarters of the larger squared error have another cause than the noise in both."""
CONTACT_GROWTH = 1.8
"""The same after the contact; below :data:`LAG`, since every deformation makes colours harder to predict, but less."""


def doubts_about_images(results: Mapping[str, Any], phase: Mapping[str, Any]) -> Iterator[Doubt]:
    """Views or frames in which images of a phase, one of ``results["phases"]``, are far worse than in the others."""
    rms = np.array(phase["images"]["rms"])
    order, train, test = view_rows(results)
    contact, worst = results["contact"], int(rms.mean(1).argmax())
    if test and _mean(rms[test]) > LAG * _mean(rms[train]):
        times = _mean(rms[test]) / _mean(rms[train])
        yield Doubt(
            "held_out_views",
            "images",
            f"residuals in held-out views are {times:.1f} times those in training views",
            "the shape is a guess where no camera looked",
            "train with more views, or with others",
        )
    if contact is not None and 0 < contact < rms.shape[1]:
        before, after = _mean(rms[:, :contact]), _mean(rms[:, contact:])
        if after > CONTACT_GROWTH * before:
            yield Doubt(
                "after_contact",
                "images",
                f"from contact on (frame {contact}) residuals are {after / before:.1f} times those in free fall",
                "the law, its parameters or the ground are not those of the video",
                "look at material and ground, or let `pacnerf-lpo diagnose` name what is missing",
            )
    if len(rms) > 2 and worst in train and _mean(rms[worst]) > LAG * _mean(np.delete(rms, worst, axis=0)):
        yield Doubt(
            "one_view",
            f"view {order[worst]}",
            "this training view stands out from all others",
            "its calibration, its clock or its exposure is wrong",
            "check its camera, or leave it out of data.train_views",
        )


def _mean(rms: np.ndarray) -> float:
    return float(np.sqrt(np.square(rms).mean()))
