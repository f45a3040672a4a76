"""What simpler rules say of the same recordings, on the same noise model: does the inference earn its code?

Two rules, each in place of priors, discrepancies, calibration and threshold:

- *BIC*: forward selection by the criterion of Schwarz (1978), D log(RSS/D) + k log D.
- *split F-test*: an effect is chosen on one half of the frames and tested by F on the other, with the false discovery
  rate of the whole library held there (Benjamini and Hochberg 1995), as LISDD does (arXiv 2606.23215).

RSS is what a linear fit of parameters and effect leaves of the whitened residual; BIC takes that of a refit where the
diagnosis has made one. A rule that chooses what the diagnosis has chosen goes on with its next model; one that chooses
something else ends there. Where a rule chooses nothing, the size of the residual relative to that of left-out
replicates says whether the cause is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import stats

from pacnerf_lpo.diagnosis.rounds import Round, leaves_more
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.hypotheses import Hypothesis

BLOCK = 2
"""Frames of one half that follow each other: neighbours are correlated, and a half must span the whole motion."""


class Linear:
    """The whitened residual of a fitted model in some entries, and its linear fits.

    Args:
        problem: of the model.
        found: a round with the model.
        mask: entries [(R, F, 11), bool]
    """

    def __init__(self, problem: Problem, found: Round, mask: np.ndarray):
        comparison = found.comparison
        self.noise = comparison.noise(problem, mask)
        self.residual = self.noise.whiten_residual(np.nan_to_num(comparison.residual[mask]))
        self.parameters = self.noise.whiten(np.nan_to_num(comparison.jacobian[mask]) * comparison.deviation)

    @property
    def size(self) -> int:
        """D."""
        return len(self.residual)

    @property
    def dof(self) -> int:
        """Of the residual after a fit of the parameters."""
        return self.size - self.parameters.shape[1]

    def left(self, change: np.ndarray | None = None, one_sided: bool = False) -> float:
        """Sum of squares that parameters, and an effect with changes of these entries (D, m), leave; infinite where a
        coefficient would have to be negative that cannot be.
        """
        columns = self.parameters
        if change is not None:
            columns = np.concatenate((self.noise.whiten(change), columns), axis=1)
        fitted = np.linalg.lstsq(columns, self.residual, rcond=None)[0]
        if one_sided and fitted[0] < 0:
            return np.inf
        return float(np.sum((self.residual - columns @ fitted) ** 2))


def bic(problem: Problem, found: Round, family: Sequence[Hypothesis], mask: np.ndarray) -> str | None:
    """The name that lowers the Bayesian information criterion most; None where none does."""
    linear = Linear(problem, found, mask)
    refitted = {again.name: again.contender.cost for again in found.refits}
    size = linear.size
    best, name = size * np.log(linear.left() / size), None
    for one in family:
        for change in one.alternatives:
            left = min(linear.left(change, one.one_sided), refitted.get(one.name, np.inf))
            criterion = size * np.log(left / size) + change.shape[1] * np.log(size)
            if criterion < best:
                best, name = criterion, one.name
    return name


def split_test(problem: Problem, found: Round, family: Sequence[Hypothesis], mask: np.ndarray) -> str | None:
    """The name that is chosen on one half of the frames, if the other half confirms it."""
    first = np.zeros(mask.shape, bool)
    first[:, np.arange(mask.shape[1]) // BLOCK % 2 == 0] = True
    choosing, testing = Linear(problem, found, mask & first), Linear(problem, found, mask & ~first)
    chosen, tested = [], []
    for one in family:
        tried = [_f_test(choosing, change[first[mask]], one.one_sided) for change in one.alternatives]
        best = int(np.argmin(tried))
        chosen.append(tried[best])
        tested.append(_f_test(testing, one.alternatives[best][~first[mask]], one.one_sided))
    leader = int(np.argmin(chosen))
    return family[leader].name if stats.false_discovery_control(tested)[leader] < LEVEL else None


def _f_test(linear: Linear, change: np.ndarray, one_sided: bool) -> float:
    """p-value of an effect with changes (D, m) in addition to the parameters."""
    count = change.shape[1]
    before, after, dof = linear.left(), linear.left(change, one_sided), linear.dof - count
    if not np.isfinite(after):
        return 1.0
    return float(stats.f.sf((before - after) / count / (after / dof), count, dof))


RULES: dict[str, Callable[[Problem, Round, Sequence[Hypothesis], np.ndarray], str | None]] = {
    "BIC": bic,
    "split F-test": split_test,
}


def verdicts(problem: Problem, rounds: Sequence[Round]) -> dict[str, dict[str, Any]]:
    """Kind of the verdict (nothing, missing, camera, unknown) and named effects, by rule."""
    return {name: _verdict(problem, rounds, rule) for name, rule in RULES.items()}


def _verdict(problem: Problem, rounds: Sequence[Round], rule: Callable[..., str | None]) -> dict[str, Any]:
    named: list[str] = []
    for found in rounds:
        chosen = rule(problem, found, found.probes.hypotheses, problem.usable) if found.probes.hypotheses else None
        if chosen is None:
            break
        named.append(chosen)
        if found.accepted is None or found.accepted.name != chosen:
            break
    if named:
        return {"kind": "camera" if all("@" in name for name in named) else "missing", "effects": named}
    return {"kind": "unknown" if leaves_more(rounds[0]) else "nothing", "effects": []}
