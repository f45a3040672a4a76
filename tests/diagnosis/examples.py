"""Records of a diagnosis with numbers that a test sets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of
from pacnerf_lpo.diagnosis.comparison import Comparison, Error
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import Screening, judge, probe
from pacnerf_lpo.identification.model_errors import ModelErrors
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.calibration import Calibration
from pacnerf_lpo.inference.checks import Check, Prediction
from pacnerf_lpo.inference.evidence import Score
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.mpm.effects.base import Effect

SHAPE = (2, 3, 11)


def score(name: str, log_bayes_factor: float) -> Score:
    return Score(name, log_bayes_factor, 0, (0.5,), (0.1,), 9.0, 3.0, np.eye(1, 66)[0])


def calibration(threshold: float = 6.0, **scales: float) -> Calibration:
    """Half of all maxima are 0, and one in ten thousand is above the threshold."""
    draws = np.sort(np.random.default_rng(0).exponential(threshold / np.log(1e4), 10_000))
    return Calibration(scales, 8.0, 0.01, threshold, draws)


def screening(outside: tuple[str, ...] = (), **factors: float) -> Screening:
    scores = [score(name, factor) for name, factor in sorted(factors.items(), key=lambda entry: -entry[1])]
    return Screening(scores, calibration(**dict.fromkeys(factors, 1.2)), list(outside), np.eye(len(scores)))


def screened(
    problem: Problem, effects: Sequence[Effect], comparison: Comparison, candidates: Sequence[Candidate]
) -> Screening:
    """All hypotheses at a fitted model, probed and judged."""
    return judge(problem, comparison, probe(problem, effects, comparison, candidates, lambda _: None))


def refit(name: str, **changes: Any) -> Refit:
    values: dict[str, Any] = {
        "name": name,
        "known": {"E": 1e5, "drag": 0.5},
        "intervals": [Interval("E", 1e5, 9e4, 1.1e5, 5e3, True)],
        "residual": np.full(SHAPE, np.nan),
        "cost_without": 200.0,
        "cost": 60.0,
        "log_bayes_factor": 20.0,
        "occam": -4.0,
        "held_without": Prediction(80.0, 1.0),
        "held": Prediction(30.0, 0.5),
        "p_value": 1e-4,
        "notes": ("a note",),
        "simulated": 12,
        "sizes": (120, 180),
    }
    return Refit(**{**values, **changes})


def comparison(names: tuple[str, ...] = ("E", "v_x")) -> Comparison:
    random, count = np.random.default_rng(0), len(names)
    return Comparison(
        names,
        np.arange(count, dtype=float),
        dict.fromkeys(names, 1.5),
        np.zeros(count),
        np.ones(count),
        61.5,
        random.standard_normal(SHAPE),
        random.standard_normal((*SHAPE, count)),
        ModelErrors(
            random.standard_normal((5, *SHAPE)),
            np.ones(SHAPE),
            *[np.zeros((*SHAPE, 0))] * 3,
            random.standard_normal((*SHAPE, 4)),
            np.zeros(4),
            np.zeros(SHAPE),
        ),
        (),
        123,
        np.ones(SHAPE, bool),
    )


def check(p_value: float, statistic: float = 1.0) -> Check:
    return Check(statistic, np.array([0.9, 1.0, 1.1]), p_value)


def round_of(
    effects: tuple[Effect, ...] = (),
    held: tuple[float, float] = (0.5, 1.0),
    screened: Screening | None = None,
    accepted: Refit | None = None,
    finished: bool = True,
    **more: Any,
) -> Round:
    """``held``: p-value and statistic of the held-out check."""
    found = Round(effects, comparison(), check(0.5), check(*held), [], [], ["free fall"] * 3, **more)
    found.errors = found.errors or (Error(0.5, 0.5),)
    found.candidates = [Candidate(name_of(effect), effect) for effect in effects]
    found.screening, found.accepted, found.finished = screened, accepted, finished
    found.refits = [] if accepted is None else [accepted]
    return found
