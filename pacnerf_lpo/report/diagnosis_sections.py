"""The parts of a diagnosis' page: first screen, parameters, points, recordings, bounds, effort; and of one round its
ranking, confounding and refits.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from pacnerf_lpo.inference.decision import DECISIVE
from pacnerf_lpo.quantities import published
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis_words import Result
from pacnerf_lpo.report.page import parts, shown
from pacnerf_lpo.report.wording import listed, readable

PARTS = parts("diagnosis")
STEPS = {
    "compare": "compare (fit, null replicates)",
    "confirm": "confirm (is the new effect still needed?)",
    "screen": "screen (one probe each)",
    "refit": "refit",
    "estimate": "estimate (fit to all data)",
}
RANKED, CONFOUNDED = 15, 12
NOTICED = 1.2
"""How many times as wide intervals have to be, as estimates disagree, that a reader is told."""
DISCREPANCIES = {
    "UnknownForce": ("unknown force", "a smooth force on the body that none of the known effects makes"),
    "WrongShape": ("wrong shape", "errors of the reconstructed shape"),
}
INDISTINGUISHABLE = 0.9
"""Correlation of two signatures from which a cell of the table is emphasised."""


def first_screen(result: Result) -> str:
    """What was compared, how far off, what is missing, what changes: four cards."""
    found = words.distance_of(result)
    bars = [("the model", found.before, "before"), ("its own error alone", found.floor, "floor")]
    if found.after is not None:
        bars.append(("the model with the effect", found.after, "after"))
    most = max(value for _, value, _ in bars)
    before, after = _parameters(result)
    moves = [
        (new["label"], before.get(name), new, new["unit"])
        for name, new in after.items()
        if not name.startswith("v_") and name != "ground_height"
    ]
    said = words.distance(result), words.missing(result), words.changes(result)
    return PARTS.cards(words.compared(result), bars, most, result["unit"], *said, moves)


def points_table(result: Result) -> str:
    """Errors of tracked points and clouds before and after [mm]; nothing where there were none."""
    names, stages = result.get("points") or [], result["stages"]
    if not names:
        return ""
    ends = stages[:1] + stages[1:][-1:]
    titles = ["root mean square error [mm]", *("before", "after")[: len(ends)], "the model's own"]
    columns = [*(stage["by_point"] for stage in ends), ends[0]["point_floor"]]
    return PARTS.points(titles, [(name, [column[row] for column in columns]) for row, name in enumerate(names)])


def parameter_table(result: Result) -> str:
    """Values before and after with their 90 % intervals, as numbers and drawn; of the solver as it is, and with its
    errors.
    """
    before, after = _parameters(result)
    deforms = any(p["solver"] for done in result["rounds"] for p in done["parameters"])
    pairs = [(name, before.get(name), after.get(name)) for name in {**before, **after}]
    rows = [(name, old or new, old, new, interval_places(old, new)) for name, old, new in pairs]
    wider = float(result["rounds"][-1]["disagreement"]) ** 0.5
    return PARTS.parameters(rows, bool(after), deforms, wider if wider > NOTICED else None)


def interval_places(
    before: Mapping[str, Any] | None, after: Mapping[str, Any] | None
) -> list[tuple[str | int | float, ...]]:
    """Two points with their intervals on a common axis, from 6 to 214: each a kind, its row, value, low and high of the
    solver as it is, and with its errors.
    """
    lines = [(kind, y, p) for kind, y, p in (("before", 11, before), ("after", 24, after)) if p is not None]
    places = np.array([(p["value"], p["low"], p["high"], *published(p)) for _, _, p in lines])
    values, finite = places[:, 0], places[np.isfinite(places)]
    reach = np.abs(values).max()
    low, high = max(finite.min(), values.min() - 2 * reach), min(finite.max(), values.max() + 2 * reach)
    shares = np.clip((places - low) / max(high - low, 1e-9 * max(reach, 1e-9)), 0.0, 1.0)
    return [(kind, y, *row) for (kind, y, _), row in zip(lines, (6 + 208 * shares).tolist(), strict=True)]


def bounds_table(result: Result) -> str:
    """How large every effect that is not in the last model can be; of its screening."""
    screen = result["rounds"][-1]["screen"]
    if screen is None:
        return ""
    rows = []
    for candidate in sorted(screen["candidates"], key=lambda c: (c["camera"], c["readable"])):
        if candidate["discrete"]:
            continue
        found = zip(candidate["coefficients"], candidate["coefficient"], candidate["interval"], strict=False)
        for coefficient, value, (low, high) in found:
            if candidate["one_sided"]:  # only the part on the side of the null on which it is; its zero has a sign, too
                side = max if math.copysign(1.0, value) > 0 else min
                low, high = side(low, 0.0), side(high, 0.0)
            cells = [shown(coefficient["null"] + end, coefficient["unit"]) for end in (low, high)]
            rows.append((candidate["readable"], coefficient["label"], *cells))
    return PARTS.table(("effect", "coefficient", "at least", "at most"), rows) if rows else ""


def effort_table(result: Result) -> str:
    """Seconds and simulations of every step of every round."""
    rows = [
        (number, STEPS.get(step, step), spent)
        for number, done in enumerate(result["rounds"], 1)
        for step, spent in done["effort"].items()
    ]
    seconds = sum(spent["seconds"] for _, _, spent in rows)
    return PARTS.effort(rows, seconds, sum(int(spent["simulations"]) for _, _, spent in rows))


def _parameters(result: Result) -> tuple[dict[str, Mapping[str, Any]], dict[str, Mapping[str, Any]]]:
    """Intervals of the first and of the last stage with labels and units; of the last none where nothing was added."""
    before = {p["name"]: p for p in result["rounds"][0]["parameters"]}
    if len(result["stages"]) == 1:
        return before, {}
    last = result["rounds"][-1]
    again = words.accepted(last)
    return before, again["values"] if again else {p["name"]: p for p in last["parameters"]}


def recordings_section(result: Mapping[str, Any]) -> str:
    """A table of the recordings with a sentence on each; nothing where there is one only."""
    recordings = result.get("recordings", [])
    if len(recordings) < 2:
        return ""
    labels = {p["name"]: p["label"] for p in result["rounds"][0]["parameters"]}
    rows = []
    for number, one in enumerate(recordings, 1):
        tells = ", ".join(f"{labels.get(name, name)} {share:.0%}" for name, share in one["tells"].items())
        seen = f"{len(one['views'])} views, {len(one['frames'])} frames"
        phases = listed(list(dict.fromkeys(one["phases"])), "and")
        rows.append((f"{number}: {one['name']}", seen, phases, asks_for(one), tells))
    return PARTS.recordings(rows)


def asks_for(recording: Mapping[str, Any]) -> str:
    """Which of the fitted effects explains this recording best, by how much its cost falls."""
    refits = recording["refits"]
    if not refits:
        return f"no effect was fitted (cost {recording['cost']:.0f} of {recording['numbers']} numbers)"
    best = min(refits, key=lambda name: refits[name])
    return f"{readable(best)}: cost {recording['cost']:.0f} falls to {refits[best]:.0f}"


def ranking(done: Mapping[str, Any]) -> str:
    """Bars of log Bayes factors, largest first, with the threshold: after a refit where there is one, else of the
    linear change; camera faults, and the hypotheses that are no effect, in other colours. Of the refits, that of the
    most probable one, and of the others as much less as it is more probable: each factor by itself is in units of its
    own noise, and does not say which of two explains more.
    """
    screen = done["screen"]
    if screen is None:
        return PARTS.untried("No effect has been tried yet.")
    leader = max(done["refits"], key=lambda again: again["log_odds"], default={"log_bayes_factor": 0.0})
    refitted = {again["name"]: leader["log_bayes_factor"] + again["log_odds"] for again in done["refits"]}
    bars = [
        {
            "factor": refitted.get(c["name"], c["log_bayes_factor"]),
            "kind": "camera" if c["camera"] else "physics",
            **{key: c[key] for key in ("name", "readable", "signature")},
        }
        for c in screen["candidates"]
    ]
    bars = sorted(bars, key=lambda bar: -bar["factor"])[:RANKED]
    for name, found in screen["discrepancies"].items():
        said = dict(zip(("readable", "signature"), DISCREPANCIES[name], strict=True))
        bars.append({"factor": found["log_bayes_factor"], "kind": "discrepancy", "name": name, **said})
    tags = dict.fromkeys(done["indistinguishable"], "not separated") | {done["accepted"]: "added"}
    bars = [{**bar, "refitted": bar["name"] in refitted, "tag": tags.get(bar["name"], "")} for bar in bars]
    bars.sort(key=lambda bar: -bar["factor"])
    most = 1.08 * max([bar["factor"] for bar in bars] + [screen["threshold"]])
    return PARTS.ranking(bars, most, screen, words.odds(screen["threshold"]), bool(refitted))


def confounding(screen: Mapping[str, Any] | None) -> str:
    """How similar the signatures of the best candidates are: a table of shades."""
    if screen is None or not screen["candidates"]:
        return PARTS.untried("No effect has been tried.")
    return PARTS.confounding(screen["candidates"][:CONFOUNDED], screen["correlations"], INDISTINGUISHABLE)


def refit_table(done: Mapping[str, Any]) -> str:
    """Every effect that was fitted with all other parameters, the most probable first."""
    if not done["refits"]:
        return PARTS.untried("No effect reached the range in which it could win, so none was fitted again.")
    known = {parameter["name"] for parameter in done["parameters"]}
    order = sorted(done["refits"], key=lambda again: (again["name"] != done["accepted"], -again["log_odds"]))
    note = "Of the effects with a p below the level, the one that is most probable relative to the others is added."
    return PARTS.refits(done, order, known, words.odds, outcome, f"{note} {words.indistinguishable(done)}".strip())


def outcome(again: Mapping[str, Any], done: Mapping[str, Any]) -> str:
    """What became of an effect that was fitted."""
    name, level = again["name"], done["screen"]["level"]
    if name == done["accepted"]:
        return "added"
    if name in done["indistinguishable"]:
        return "not separated from the added one"
    if again["p_value"] >= level:
        return f"p above {level:.0%}: chance explains it"
    added = words.accepted(done) or again
    behind = added["log_odds"] - again["log_odds"]
    if behind >= DECISIVE:
        return f"{words.odds(behind, short=True)} for the added one"
    return "a fault of a held-out camera, compared separately" if again["camera"] else "not added"
