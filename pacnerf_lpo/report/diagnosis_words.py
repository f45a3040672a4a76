"""A diagnosis in words for a reader who knows no statistics."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from pacnerf_lpo.inference.decision import DECISIVE, LEVEL
from pacnerf_lpo.report.wording import capitalised, listed, probability, readable, together

Result = Mapping[str, Any]

NOT_IDENTIFIABLE = (
    "Motion alone gives E / rho, eta / rho and yield stress / rho, not the density itself.",
    "A time offset common to all cameras looks like another initial position and velocity.",
    "Another strength of gravity looks like another length scale.",
    "A tilt of the world looks like a uniform sideways force.",
)


@dataclass(frozen=True)
class Light:
    """The mark next to the verdict.

    colour: ``good`` (green), ``fair`` (amber), ``poor`` (red) or ``none``.
    caption: what it stands for.
    """

    colour: str
    caption: str


LIGHTS = {
    "nothing": Light("good", "nothing is missing"),
    "missing": Light("fair", "cause found"),
    "camera": Light("fair", "a camera is wrong"),
    "unknown": Light("poor", "cause unknown"),
    "unfinished": Light("none", "not finished"),
}
DOUBT = Light("fair", "reconstruction in doubt")
PARTIAL = Light("fair", "cause found, not all explained")


def light(verdict: Mapping[str, Any]) -> Light:
    """The mark next to a verdict."""
    if verdict["doubt"]:
        return DOUBT
    return PARTIAL if verdict["kind"] == "missing" and verdict["more_than_noise"] else LIGHTS[verdict["kind"]]


@dataclass(frozen=True)
class Distance:
    """How far the model is from what was measured [the unit of the result].

    before: the model as it was fitted.
    floor: what its own numerical error alone would give.
    after: with all that was found; None where nothing was added.
    where: in which data.
    """

    before: float
    floor: float
    after: float | None
    where: str


HELD_OUT = "in the held-out data"


def distance_of(result: Result) -> Distance:
    """Of the held-out data; of the wrong camera where one was found and nothing else."""
    first, last = result["stages"][0], result["stages"][-1]
    changed = len(result["stages"]) > 1
    if result["verdict"]["kind"] == "camera":
        view_id = int(result["verdict"]["effects"][0].partition("@")[2])
        view = result["views"].index(view_id)
        after = last["by_view"][view] if changed else None
        return Distance(first["by_view"][view], first["view_floor"][view], after, f"in camera {view_id}")
    after = last["error"]["held"] if changed else None
    return Distance(first["error"]["held"], first["floor"]["held"], after, HELD_OUT)


def unit_of(result: Result) -> str:
    """``pixels``, or ``mm`` where points alone were compared."""
    return "pixels" if result["unit"] == "px" else result["unit"]


def length(value: float, result: Result) -> str:
    """``0.89 pixels``."""
    return f"{value:.2f} {unit_of(result)}" if value < 10 else f"{value:.0f} {unit_of(result)}"


def compared(result: Result) -> str:
    """Which data were fitted, and which were held out."""
    if flights := result.get("flights"):
        samples = sum(len(one["times"]) for one in flights)
        return (
            f"The positions that were measured in {samples} samples of {_count(len(flights), 'flight')}, with those "
            "that the model predicts. The last samples of each were held out: no model that competes was fitted to "
            "them, so they check whether a model predicts what it has not seen. Then values and intervals come from "
            "all samples."
        )
    frames, last = len(result["frames"]), _count(len(result["held_frames"]), "frame")
    if result["unit"] == "px":
        what = f"The outline of the object in {len(result['views'])} cameras and {frames} frames, with the outline"
        views = result["held_views"]
        named = f"Camera{'s' * (len(views) > 1)} {listed([*map(str, views)], 'and')}" if views else "No camera"
        held = f"{named} and the"
    else:
        tracked = sum(name.startswith("point ") for name in result["points"])
        points = [f"{tracked} tracked points"] * (tracked > 0) + ["point clouds"] * (tracked < len(result["points"]))
        what = f"The positions of {' and '.join(points)} in {frames} frames, with those"
        held = "Every third tracked point and the" if tracked else "The"
    return (
        f"{what} that the model predicts. {held} last {last} were held out: no model that competes was fitted to them, "
        "so they count for whether a model predicts what it has not seen. Once it is decided what is missing, values "
        "and intervals come from all data."
    )


def distance(result: Result) -> str:
    """How far off the model is, relative to its own error."""
    found, outlines = distance_of(result), result["unit"] == "px"
    what = "edges and centres of the outlines" if outlines else "the points"
    sentence = (
        f"{capitalised(found.where)}, {what} are typically {length(found.before, result)} from where they should be. "
        "Null replicates (simulations of this model on other grids, with other particles and noise) are typically "
        f"{length(found.floor, result)} away from it: "
    )
    return sentence + _relative(found, result["rounds"][0], "the video" if outlines else "what was measured")


def _relative(found: Distance, first: Mapping[str, Any], measured: str) -> str:
    """The distance in units of that of the replicates, and whether chance explains it."""
    times, inside = found.before / max(found.floor, 1e-9), first["check"]["p_value"] < LEVEL
    farther = f"{measured} is {times:.1f} times as far away as that"
    outside = first["check_held"]["p_value"] < LEVEL or (found.where != HELD_OUT and times >= 2)
    if outside and times >= 1.1:
        return f"{farther}, which is too much for chance."
    if outside:
        return f"{measured} is no farther away on average, but differs in a pattern that chance does not make."
    if first["accepted"] and not inside:
        size, cause = farther if times >= 1.1 else f"{measured} is no farther away", readable(first["accepted"])
        return f"{size}. Chance would explain that size, but not that the error looks like {cause}."
    end = " In the fitted data the residual is larger than chance explains." if inside else ""
    return f"{farther}, which chance explains.{end}" if times >= 1.1 else f"{measured} is no farther away.{end}"


def chance(p: float) -> str:
    """A p-value in words."""
    if p >= 0.5:
        return "chance alone does this more often than not"
    if p < 1e-4:
        return "chance alone would do this in less than 1 of 10 000 recordings in which nothing is missing"
    recordings = float(f"{1 / p:.1g}") if p <= 0.01 else 1 / p
    return f"chance alone would do this in about 1 of {recordings:.0f} recordings in which nothing is missing"


def odds(log_bayes_factor: float, short: bool = False) -> str:
    """``67 to 1``: odds of an effect, if they were even before; ``1 to 12`` where the recording speaks against it."""
    size = math.exp(min(abs(log_bayes_factor), 20.0))
    most = "over 1 000 000" if short else "more than a million"
    text = most if size > 1e6 else f"{size:.1f}" if size < 9.95 else f"{int(float(f'{size:.2g}')):,}".replace(",", " ")
    return f"{text} to 1" if log_bayes_factor >= 0 else f"1 to {text}"


def accepted(done: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The refit with the effect that a round has accepted; None where it has accepted none."""
    return next((again for again in done["refits"] if again["name"] == done["accepted"]), None)


def refits_of(result: Result) -> list[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """The rounds in which an effect was accepted that stayed in the model, each with its refit."""
    gone = {name for done in result["rounds"] for name in done["removed"]}
    found = [(done, accepted(done)) for done in result["rounds"]]
    return [(done, again) for done, again in found if again and again["name"] not in gone]


def missing(result: Result) -> list[str]:
    """What is missing and how sure that is, or why nothing is named."""
    kind = result["verdict"]["kind"]
    if kind in ("missing", "camera"):
        return [sentence for done, again in refits_of(result) for sentence in _named(done, again)]
    effects = {c["name"] for done in result["rounds"] if done["screen"] for c in done["screen"]["candidates"]}
    tried = f"{len(effects)} effects and camera faults were tried."
    if kind == "unfinished":
        return ["Not determined yet: no candidates were fitted."]
    if kind == "nothing":
        return [
            tried,
            *_best(result["rounds"][-1]),
            "How large each of them can still be stands at the end of the page.",
        ]
    force = (result["rounds"][-1]["screen"] or {"discrepancies": {}})["discrepancies"].get("UnknownForce")
    against = "" if force is None else f", for which the odds are {odds(force['log_bayes_factor'])}"
    return [f"{tried} None explains the residual as well as a smooth force of unknown cause{against}."]


def _named(done: Mapping[str, Any], again: Mapping[str, Any]) -> list[str]:
    name, others = again["readable"], [readable(other) for other in done["indistinguishable"] if other != again["name"]]
    alternatives = f" (or {listed(others)}: this recording does not separate them)" if others else ""
    return [
        f"{capitalised(name)}{alternatives}: {again['signature']}.",
        f"If {name} and its absence were equally plausible beforehand, the odds for it are now "
        f"{odds(again['log_bayes_factor'])}; {chance(again['p_value'])}.",
    ]


def _best(done: Mapping[str, Any]) -> list[str]:
    """What the best candidate of a round has, and how often the best has as much where nothing is missing."""
    candidates = (done["screen"] or {"candidates": []})["candidates"]
    if not candidates:
        return []
    found = max(candidates, key=lambda candidate: candidate["log_bayes_factor"])
    return [
        f"The best of them before any was fitted, {found['readable']}, has odds of {odds(found['log_bayes_factor'])}, "
        f"with even odds beforehand; {chance(found['p_value'])}."
    ]


def changes(result: Result) -> str:
    """What adding the effects does."""
    found = distance_of(result)
    if found.after is None:
        return "Nothing was added to the model."
    before, after = (result["stages"][k]["error"]["fitted"] for k in (0, -1))
    moved, place = _moved(found.before, found.after, result), capitalised(found.where)
    if found.where != HELD_OUT:
        return f"{place}, the distance {moved}."
    sentence = f"{place}, the distance {moved}; in the fitted data it {_moved(before, after, result)}."
    removed, held = result["verdict"]["removed"], result["rounds"][0]["check_held"]
    if found.after > found.before and removed and held["statistic"] > fmean(held["replicates"]):
        sentence += (
            f" In {unit_of(result)} all numbers count equally; with each number weighted by its noise, the held-out "
            f"error beyond noise falls by {removed:.0%}."
        )
    return sentence


def _moved(before: float, after: float, result: Result) -> str:
    if f"{before:.2f}" == f"{after:.2f}":
        return f"stays at {length(after, result)}"
    return f"{'falls' if after < before else 'rises'} from {before:.2f} to {length(after, result)}"


def experiments(result: Result) -> list[tuple[str, str]]:
    """For every choice of effects that the recording does not separate: their names, and what would separate them."""
    found: dict[str, str] = {}
    for done in result["rounds"]:
        left, by_name = done["indistinguishable"], {again["name"]: again for again in done["refits"]}
        if done.get("plan"):
            best = done["plan"][0]
            found[together(left)] = f"{best['words']} (expected odds for the true one: {odds(best['score'])})"
            continue
        advice = [by_name[name]["separating_experiment"] for name in left if name in by_name]
        if len(left) > 1 and any(advice):
            found.setdefault(together(left), next(one for one in advice if one))
    return list(found.items())


def indistinguishable(done: Mapping[str, Any]) -> str:
    """Which effects a round leaves to choose from; empty where it leaves one."""
    if len(done["indistinguishable"]) < 2:
        return ""
    return (
        f"This recording does not separate {together(done['indistinguishable'])}: the odds of the added one to each of "
        f"the others are below {odds(DECISIVE)}."
    )


def checked(done: Mapping[str, Any]) -> str:
    """Whether the model of a round predicts the fitted and the held-out data within its error."""
    parts = []
    for key, where in (("check", "fitted"), ("check_held", "held-out")):
        check = done[key]
        times = check["statistic"] / fmean(check["replicates"])
        verdict = "more than its error explains" if check["p_value"] < LEVEL else "within its error"
        said = f"{verdict} ({probability(check['p_value'])})"
        parts.append(f"in the {where} data {times:.2g} times that of the null replicates, {said}")
    return f"Mean square of the standardised residual: {'; '.join(parts)}."


def notes(result: Result) -> list[str]:
    """What is suspect about the estimates of the last model (at a bound, or far from the guess), and the hypotheses
    that could not be examined.
    """
    last = result["rounds"][-1]
    left_out = (sentence for done in result["rounds"] for sentence in done["left_out"])
    return [*(accepted(last) or last)["notes"], *left_out]


def undetermined(result: Result) -> list[str]:
    """What the recording does not determine in the last model, with labels in place of names."""
    last = result["rounds"][-1]
    labels = {p["name"]: p["label"] for p in last["parameters"]}
    pattern = "|".join(rf"\b{re.escape(name)}\b" for name in sorted(labels, key=len, reverse=True))
    return [re.sub(pattern, lambda found: labels[found[0]], sentence) for sentence in last["undetermined"]]


def _count(count: int, noun: str) -> str:
    return noun if count == 1 else f"{count} {noun}s"
