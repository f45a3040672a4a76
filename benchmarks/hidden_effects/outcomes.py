"""What a diagnosis said of one scene beside what was hidden in it. Nothing else opens ``truth.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects.full import reconstructed_from
from benchmarks.hidden_effects.known_shape import TRUTH
from benchmarks.hidden_effects.run import EFFORT, FAILURE
from pacnerf_lpo.diagnosis.store import FOLDER
from pacnerf_lpo.report.diagnosis_result import RESULT

DRAGS = frozenset({"LinearDrag", "QuadraticDrag"})
POSE = frozenset({"CameraShift", "CameraRotation"})
LOGARITHMIC = ("E", "mu", "kappa", "tau_y")


@dataclass(frozen=True)
class Outcome:
    """One scored scene.

    seed, family, snr: as planned;  views: that it was reconstructed from, in words; None: the shape is known.
    truth: names of the hidden effects.
    kind: of the verdict: nothing, missing, camera, unknown; ``failed`` where there is none.
    accepted: names of the effects that were accepted, in order; none where they explain too little.
    ranking: names, best first: the accepted effect, the other refits by misfit, the rest by score.
    groups: names that the diagnosis says it cannot tell apart.
    removed: share of the held-out excess error that the accepted effects removed together; None if none.
    unexplained: whether the verdict says that more than noise is left, by the named effects or with nothing missing.
    coefficients: (covered by its interval, yes or no) of the true effect's coefficients where it was refitted.
    stated: the same in the table that the report ends with, where that has the effect.
    coefficient_error: of the true effect where it was refitted, relative to its size.
    bias: |log10| of the material's first logarithmic parameter beside the truth, without and with the accepted effects.
    beyond: of a stranger, the signal-to-noise ratio that its best imitation leaves; None: not measured.
    base: whether the 90 % intervals of the first model cover the true material and velocity.
    base_stated: the same in the table that the report ends with, where the true effect was accepted.
    seconds: of processor time.
    """

    seed: int
    family: str
    snr: float
    views: str | None
    truth: tuple[str, ...]
    kind: str
    accepted: tuple[str, ...] = ()
    ranking: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    removed: float | None = None
    unexplained: bool = False
    coefficients: tuple[bool, ...] = ()
    stated: tuple[bool, ...] = ()
    coefficient_error: float | None = None
    bias: tuple[float, float] | None = None
    beyond: float | None = None
    base: tuple[bool, ...] = ()
    base_stated: tuple[bool, ...] = ()
    seconds: float = 0.0

    @property
    def in_doubt(self) -> bool:
        """Whether nothing is said to be missing, and the reconstruction to be in doubt."""
        return self.kind == "nothing" and self.unexplained

    def alike(self, one: str, other: str) -> bool:
        """Whether two names are one class: told apart neither by this recording nor by any of its length."""
        kinds, views = {one.split("@")[0], other.split("@")[0]}, {one.partition("@")[2], other.partition("@")[2]}
        if one == other or kinds <= DRAGS or (kinds <= POSE and len(views) == 1):
            return True
        return any(one in group and other in group for group in self.groups)

    def found(self, name: str) -> bool:
        """Whether an effect, or one of its class, was accepted."""
        return any(self.alike(name, other) for other in self.accepted)

    def within(self, count: int, exact: bool = False) -> bool:
        """Whether a hidden effect is among the first names, or the first classes, of the ranking."""
        if exact:
            return any(name in self.ranking[:count] for name in self.truth)
        leaders: list[str] = []
        for name in self.ranking:
            if not any(self.alike(name, leader) for leader in leaders):
                leaders.append(name)
        return any(self.alike(name, leader) for name in self.truth for leader in leaders[:count])


def outcome(scene: Path) -> Outcome | None:
    """The outcome of a scene; None if it was not diagnosed yet."""
    truth = json.loads((scene / TRUTH).read_text())
    names = tuple(hidden["name"] for hidden in truth["hidden"])
    head = (truth["seed"], truth["family"], truth["snr"], reconstructed_from(scene), names)
    beyond = next((hidden["beyond"] for hidden in truth["hidden"] if hidden.get("beyond")), None)
    if not (scene / EFFORT).is_file():
        return Outcome(*head, "failed", beyond=beyond) if (scene / FAILURE).is_file() else None
    result = json.loads((scene / FOLDER / RESULT).read_text())
    rounds, screen = result["rounds"], result["rounds"][0]["screen"] or {"candidates": [], "groups": []}
    taken = [_accepted(found) for found in rounds if found["accepted"] and result["verdict"]["kind"] != "unknown"]
    coefficients, error = _coefficients(truth, rounds[0]["refits"])
    before, last = ({entry["name"]: entry for entry in found["parameters"]} for found in (rounds[0], rounds[-1]))
    after = taken[-1]["values"] if taken else before
    truth_named = bool(names) and set(names) <= {again["name"] for again in taken}
    return Outcome(
        *head,
        kind=result["verdict"]["kind"],
        accepted=tuple(again["name"] for again in taken),
        ranking=_ranking(rounds[0], screen),
        groups=tuple(tuple(group) for group in screen["groups"]),
        removed=1 - float(np.prod([1 - again["removed"] for again in taken])) if taken else None,
        unexplained=result["verdict"].get("rest", False),
        coefficients=coefficients,
        stated=_covered(_moved(truth), last) if taken else (),
        coefficient_error=error,
        bias=_bias(truth["values"], before, after),
        beyond=beyond,
        base=_covered(truth["values"], before),
        base_stated=_covered(truth["values"], last) if truth_named else (),
        seconds=json.loads((scene / EFFORT).read_text())["cpu_seconds"],
    )


def _accepted(found: dict) -> dict:
    return next(again for again in found["refits"] if again["name"] == found["accepted"])


def _ranking(first: dict, screen: dict) -> tuple[str, ...]:
    refits = sorted(first["refits"], key=lambda again: (again["name"] != first["accepted"], again["misfit"]))
    names = [entry["name"] for entry in (*refits, *screen["candidates"])]
    return tuple(dict.fromkeys(names))


def _coefficients(truth: dict, refits: Sequence[dict]) -> tuple[tuple[bool, ...], float | None]:
    """Of a single hidden effect: which true coefficients lie in their intervals, and the relative error of all."""
    if len(truth["hidden"]) != 1:
        return (), None
    hidden = truth["hidden"][0]
    again = next((refit for refit in refits if refit["name"] == hidden["name"]), None)
    if again is None:
        return (), None
    true, null, values = _moved(truth), hidden["null"], again["values"]
    miss = np.array([values[name]["value"] - true[name] for name in true])
    size = np.array([min(abs(true[name] - null[name]), abs(true[name]) or np.inf) for name in true])
    return _covered(true, values), float(np.linalg.norm(miss) / np.linalg.norm(size))


def _moved(truth: dict) -> dict[str, float]:
    """The coefficients of the hidden effects that differ from their nulls."""
    pairs = [(name, value, hidden["null"]) for hidden in truth["hidden"] for name, value in hidden["values"].items()]
    return {name: value for name, value, null in pairs if value != null[name]}


def _covered(true: Mapping[str, float], told: Mapping[str, dict]) -> tuple[bool, ...]:
    """Whether each true value that a table tells of lies in its interval."""
    return tuple(bool(told[n]["low"] <= value <= told[n]["high"]) for n, value in true.items() if n in told)


def _bias(true: dict[str, float], before: dict, after: dict) -> tuple[float, float] | None:
    for name in LOGARITHMIC:
        if name in true and name in before and name in after:
            return tuple(abs(float(np.log10(told[name]["value"] / true[name]))) for told in (before, after))  # type: ignore
    return None
