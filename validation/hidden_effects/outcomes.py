"""What a diagnosis said of one scene, and what was hidden in it. Nothing else opens ``truth.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pacnerf_lpo.diagnosis.store import FOLDER
from pacnerf_lpo.quantities import published
from pacnerf_lpo.report.diagnosis_result import RESULT
from validation.hidden_effects.full import reconstructed_from
from validation.hidden_effects.known_shape import TRUTH
from validation.hidden_effects.run import EFFORT, FAILURE, SIMPLER

KEPT = 5
"""Names of a ranking that are kept: tables count the first three."""


@dataclass(frozen=True)
class Outcome:
    """One scored scene.

    seed, family, snr: as planned;  views: that it was reconstructed from, in words; None: the shape is known.
    truth: names of the hidden effects.
    kind: of the verdict: nothing, missing, camera, unknown, unfinished; ``failed`` where there is none.
    named: effects that the verdict names, in order.
    classes: for each of them, the names that the recording does not tell apart from it, itself first.
    ranking: first names of the first round: its refits by their odds, by which a verdict chooses and the report lists
        them, then its other candidates by their Bayes factors.
    p_value: of the best of all hypotheses of the first round, unknown force and wrong shape among them, before any was
        fitted: of the selection whose chances are simulated.
    fitted: the smallest of the same hypotheses where those that were fitted count as fitted.
    more_than_noise: whether the verdict says that what is left is more than the model predicts.
    covered: whether the 90 % interval that the report shows, which contains what another solver may change, has the
        true value, by parameter: of the hidden coefficients that the last model has, and, where it has all that was
        hidden and nothing else, of material and velocity.
    covered_alone: the same of the intervals of this solver alone.
    hidden: names of the coefficients among those.
    beyond: of an effect outside the catalogue, the signal-to-noise ratio that its best imitation leaves; None: not
        measured.
    seconds: of processor time.
    simpler: kind of the verdict and named effects by other rules, see :mod:`.simpler`; where the shape is known.
    """

    seed: int
    family: str
    snr: float
    views: str | None
    truth: tuple[str, ...]
    kind: str
    named: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    ranking: tuple[str, ...] = ()
    p_value: float | None = None
    fitted: float | None = None
    more_than_noise: bool = False
    covered: dict[str, bool] = field(default_factory=dict)
    covered_alone: dict[str, bool] = field(default_factory=dict)
    hidden: tuple[str, ...] = ()
    beyond: float | None = None
    seconds: float = 0.0
    simpler: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether the diagnosis ended with an error."""
        return self.kind == "failed"

    def said_by(self, rule: str | None) -> tuple[str, list[str]]:
        """Kind of the verdict and named effects, by another rule; None: by the diagnosis."""
        if rule is None:
            return self.kind, list(self.named)
        said = self.simpler[rule]
        return said["kind"], said["effects"]

    def found(self, name: str) -> bool:
        """Whether an effect is in one of the classes that were named."""
        return any(name in group for group in self.classes)

    def top(self, count: int) -> bool:
        """Whether a hidden effect is among the first names of the ranking."""
        return any(name in self.ranking[:count] for name in self.truth)

    def inside(self, what: str, alone: bool = False) -> list[bool]:
        """Which true values their intervals cover: of ``coefficient``, ``velocity`` or ``material``; ``alone``: those
        of this solver alone.
        """
        covered = self.covered_alone if alone else self.covered
        return [covers for name, covers in covered.items() if self._kind(name) == what]

    def _kind(self, name: str) -> str:
        if name in self.hidden:
            return "coefficient"
        return "velocity" if name in ("v_x", "v_y", "v_z") else "material"


def outcome(scene: Path) -> Outcome | None:
    """The outcome of a scene; None if it was not diagnosed yet."""
    truth = json.loads((scene / TRUTH).read_text())
    names = tuple(hidden["name"] for hidden in truth["hidden"])
    head = (truth["seed"], truth["family"], truth["snr"], reconstructed_from(scene), names)
    beyond = next((hidden["beyond"] for hidden in truth["hidden"] if hidden.get("beyond")), None)
    if not (scene / EFFORT).is_file():
        return Outcome(*head, "failed", beyond=beyond) if (scene / FAILURE).is_file() else None
    result = json.loads((scene / FOLDER / RESULT).read_text())
    rounds, verdict = result["rounds"], result["verdict"]
    named = tuple(verdict["effects"])
    of_round = {found["accepted"]: found["indistinguishable"] for found in rounds if found["accepted"]}
    classes = tuple(tuple(of_round.get(name) or [name]) for name in named)
    moved = _moved(truth)
    table = {entry["name"]: entry for entry in rounds[-1]["parameters"]}
    true = {**moved, **(truth["values"] if set(named) == set(names) else {})}
    return Outcome(
        *head,
        kind=verdict["kind"],
        named=named,
        classes=classes,
        ranking=_ranking(rounds[0])[:KEPT],
        p_value=_smallest(rounds[0], []),
        fitted=_smallest(rounds[0], rounds[0]["refits"]),
        more_than_noise=verdict["more_than_noise"],
        covered=_covered(true, {name: published(entry) for name, entry in table.items()}),
        covered_alone=_covered(true, {name: (entry["low"], entry["high"]) for name, entry in table.items()}),
        hidden=tuple(name for name in moved if name in table),
        beyond=None if beyond is None else round(beyond, 1),
        seconds=round(json.loads((scene / EFFORT).read_text())["cpu_seconds"]),
        simpler=json.loads((scene / SIMPLER).read_text()) if (scene / SIMPLER).is_file() else {},
    )


def _ranking(first: dict) -> tuple[str, ...]:
    screened = [] if first["screen"] is None else first["screen"]["candidates"]
    refitted = sorted(first["refits"], key=lambda again: -again["log_odds"])
    others = sorted(screened, key=lambda candidate: -candidate["log_bayes_factor"])
    return tuple(dict.fromkeys(entry["name"] for entry in (*refitted, *others)))


def _smallest(first: dict, refits: list[dict]) -> float | None:
    screen = first["screen"] or {"candidates": [], "discrepancies": {}}
    again = {entry["name"] for entry in refits}
    others = [entry for entry in screen["candidates"] if entry["name"] not in again]
    entries = [*refits, *others, *screen["discrepancies"].values()]
    return min((float(f"{entry['p_value']:.3g}") for entry in entries), default=None)


def _moved(truth: dict) -> dict[str, float]:
    """The coefficients of the hidden effects that differ from their nulls."""
    pairs = [(name, value, hidden["null"]) for hidden in truth["hidden"] for name, value in hidden["values"].items()]
    return {name: value for name, value, null in pairs if value != null[name]}


def _covered(true: Mapping[str, float], ends: Mapping[str, tuple[float, float]]) -> dict[str, bool]:
    """Whether each true value that has an interval lies between its ends."""
    return {n: bool(ends[n][0] <= value <= ends[n][1]) for n, value in true.items() if n in ends}
