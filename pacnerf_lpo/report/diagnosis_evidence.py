"""Evidence of one round on a diagnosis' page: ranking, confounding and refits."""

from collections.abc import Mapping
from typing import Any

from pacnerf_lpo.inference.decision import DECISIVE
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.page import parts

PARTS = parts("diagnosis")
RANKED, CONFOUNDED = 15, 12
DISCREPANCIES = {
    "UnknownForce": ("unknown force", "a smooth force on the body that none of the known effects makes"),
    "WrongShape": ("wrong shape", "errors of the reconstructed shape"),
}
INDISTINGUISHABLE = 0.9
"""Correlation of two signatures from which a cell of the table is emphasised."""


def ranking(done: Mapping[str, Any]) -> str:
    """Bars of log Bayes factors, largest first, with the threshold: after a refit where there is one, else of the
    linear change; camera faults, and the hypotheses that are no effect, in other colours.
    """
    screen = done["screen"]
    if screen is None:
        return PARTS.untried("No effect has been tried yet.")
    refitted = {again["name"]: again["log_bayes_factor"] for again in done["refits"]}
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
    added = next((one for one in done["refits"] if one["name"] == done["accepted"]), again)
    behind = added["log_odds"] - again["log_odds"]
    if behind >= DECISIVE:
        return f"{words.odds(behind, short=True)} for the added one"
    return "a fault of a held-out camera, compared separately" if again["camera"] else "not added"
