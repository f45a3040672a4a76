"""A diagnosis in words for a reader who knows no statistics."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pacnerf_lpo.diagnosis.rounds import BY_ITSELF, MORE_THAN_NOISE

Result = Mapping[str, Any]

NOT_IDENTIFIABLE = (
    "Motion alone gives E / rho, eta / rho and yield stress / rho, not the density itself.",
    "A time offset common to all cameras looks like another initial position and velocity.",
    "Another strength of gravity looks like another length scale.",
    "A tilt of the world looks like a uniform sideways force.",
)


@dataclass(frozen=True)
class Light:
    """The mark beside the verdict.

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


def light(verdict: Mapping[str, Any]) -> Light:
    """The mark beside a verdict."""
    return DOUBT if verdict["kind"] == "nothing" and verdict["rest"] else LIGHTS[verdict["kind"]]


@dataclass(frozen=True)
class Misfit:
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


def misfit(result: Result) -> Misfit:
    """Of the data kept aside; of the wrong camera where one was found and nothing else."""
    first, last = result["stages"][0], result["stages"][-1]
    changed = len(result["stages"]) > 1
    if result["verdict"]["kind"] == "camera" and "@" in result["verdict"]["effects"][0]:
        view_id = int(result["verdict"]["effects"][0].partition("@")[2])
        view = result["views"].index(view_id)
        after = last["by_view"][view] if changed else None
        return Misfit(first["by_view"][view], first["view_floor"][view], after, f"in camera {view_id}")
    after = last["error"]["held"] if changed else None
    return Misfit(first["error"]["held"], first["floor"]["held"], after, "in the data kept aside")


def unit_of(result: Result) -> str:
    """``pixels``, or ``mm`` where points alone were compared."""
    return "pixels" if result["unit"] == "px" else result["unit"]


def length(value: float, result: Result) -> str:
    """``0.89 pixels``."""
    return f"{value:.2f} {unit_of(result)}" if value < 10 else f"{value:.0f} {unit_of(result)}"


def compared(result: Result) -> str:
    """Which data were fitted, and which were kept aside."""
    frames, last = len(result["frames"]), _count(len(result["held_frames"]), "frame")
    if result["unit"] == "px":
        what = f"The outline of the object in {len(result['views'])} cameras and {frames} frames, with the outline"
        aside = f"{_some(result['held_views'], 'camera')} and the"
    else:
        tracked = sum(name.startswith("point ") for name in result["points"])
        points = [f"{tracked} tracked points"] * (tracked > 0) + ["point clouds"] * (tracked < len(result["points"]))
        what = f"The positions of {' and '.join(points)} in {frames} frames, with those"
        aside = "Every third tracked point and the" if tracked else "The"
    return (
        f"{what} that the model predicts. {aside} last {last} were kept aside: the model was never adjusted to them, "
        "so they tell whether a change is a real improvement."
    )


def distance(result: Result) -> str:
    """How far off the model is, beside its own error."""
    found, outlines = misfit(result), result["unit"] == "px"
    times = found.before / max(found.floor, 1e-9)
    what = "edges and centres of the outlines" if outlines else "the points"
    measured = "the video" if outlines else "what was measured"
    sentence = (
        f"{found.where[0].upper()}{found.where[1:]}, {what} are typically {length(found.before, result)} from where "
        "they should be. Simulated copies of this model, computed a little differently, differ from it by "
        f"{length(found.floor, result)}: "
    )
    first = result["rounds"][0]
    more = first["omnibus"]["p_value"] < MORE_THAN_NOISE or first["omnibus_held"]["p_value"] < BY_ITSELF
    if more and times >= 1.1:
        return f"{sentence}{measured} is {times:.1f} times as far away as that, which is too far to be an accident."
    if more:
        return f"{sentence}as a whole no more, but the differences have a pattern that accidents do not make."
    return f"{sentence}{measured} is no farther away than that."


def chance(p: float) -> str:
    """A p-value in words."""
    if p >= 0.5:
        return "accidents alone do this more often than not"
    if p < 1e-4:
        return "accidents alone would do this in less than 1 of 10 000 recordings"
    return f"accidents alone would do this in about 1 of {_round(1 / p)} recordings"


def refits_of(result: Result) -> list[Mapping[str, Any]]:
    """The accepted refits, in the order in which they were accepted."""
    found = []
    for done in result["rounds"]:
        found += [again for again in done["refits"] if again["name"] == done["accepted"]]
    return found


def missing(result: Result) -> str:
    """What is missing, or why nothing is named."""
    kind, accepted = result["verdict"]["kind"], refits_of(result)
    if kind in ("missing", "camera"):
        return " ".join(
            f"{again['readable'].capitalize()}{_like(result, again['name'])}: {again['signature']}."
            for again in accepted
        )
    tried = len({c["name"] for done in result["rounds"] if done["screen"] for c in done["screen"]["candidates"]})
    if kind == "nothing":
        return (
            f"{tried} effects and camera faults were tried and none explains anything. How strong each of them may "
            "still be without being seen stands below."
        )
    if kind == "unknown":
        return (
            f"{tried} effects and camera faults were tried. None removes enough of the error in the data kept aside "
            "to be believed."
        )
    return "Not looked for yet: the diagnosis was stopped before candidates were fitted."


def changes(result: Result) -> str:
    """What adding the effects does."""
    found = misfit(result)
    if found.after is None:
        return "Nothing was added to the model."
    before, after = (result["stages"][k]["error"]["fitted"] for k in (0, -1))
    sentence = f"{found.where[0].upper()}{found.where[1:]}, the distance falls from {found.before:.2f} to "
    sentence += length(found.after, result)
    fitted = f" (where the model was adjusted, from {before:.2f} to {after:.2f})" if "aside" in found.where else ""
    return f"{sentence}{fitted}."


def experiments(result: Result) -> list[tuple[str, str]]:
    """For every class that cannot be told apart and that may be meant: its names, and what would separate them."""
    found: dict[str, str] = {}
    for done in result["rounds"]:
        screen = done["screen"]
        if screen is None:
            continue
        by_name = {candidate["name"]: candidate for candidate in screen["candidates"]}
        for group in screen["groups"]:
            members = [by_name[name] for name in group if name in by_name]
            if len(members) > 1 and any(abs(member["z"]) >= screen["threshold"] for member in members):
                advice = [m["separating_experiment"] for m in members if m["separating_experiment"]]
                names = either([member["readable"] for member in members])
                if advice:
                    found.setdefault(names, advice[0])
    return list(found.items())


def undetermined(result: Result) -> list[str]:
    """What the recording does not determine in the last model, with labels in the place of parameters' names."""
    last = result["rounds"][-1]
    labels = {p["name"]: p["label"] for p in last["parameters"]}
    pattern = "|".join(rf"\b{re.escape(name)}\b" for name in sorted(labels, key=len, reverse=True))
    return [re.sub(pattern, lambda found: labels[found[0]], sentence) for sentence in last["undetermined"]]


def either(names: Sequence[str]) -> str:
    """``a, b or c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _like(result: Result, name: str) -> str:
    """The effects that cannot be told apart from one, in brackets; without those that were fitted and rejected."""
    for done in result["rounds"]:
        if done["screen"] is None or done["accepted"] != name:
            continue
        by_name = {candidate["name"]: candidate["readable"] for candidate in done["screen"]["candidates"]}
        rejected = {again["name"] for again in done["refits"] if not again["accepted"]}
        alike = [group for group in done["screen"]["groups"] if name in group]
        others = [by_name[other] for group in alike for other in group if other != name and other not in rejected]
        return f" (or {either(others)}: this recording cannot tell)" if others else ""
    return ""


def _some(ids: Sequence[int], noun: str) -> str:
    if len(ids) == 1:
        return f"{noun.capitalize()} {ids[0]}"
    return f"{noun.capitalize()}s {', '.join(map(str, ids[:-1]))} and {ids[-1]}" if ids else f"No {noun}"


def _count(count: int, noun: str) -> str:
    return noun if count == 1 else f"{count} {noun}s"


def _round(value: float) -> str:
    digits = max(0, math.floor(math.log10(value)))
    return f"{round(value, -digits) if digits > 1 else round(value):.0f}"
