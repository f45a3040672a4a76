"""Evidence of one round on a diagnosis' page: ranking, confounding and refits."""

from collections.abc import Mapping
from typing import Any

from pacnerf_lpo.inference.decision import DECISIVE
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis_markup import interval_text, share, signed, table, text

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
        return '<p class="muted">No effect has been tried yet.</p>'
    refitted = {again["name"]: again["log_bayes_factor"] for again in done["refits"]}
    entries = [
        (refitted.get(c["name"], c["log_bayes_factor"]), c["name"], c["readable"], c["signature"], c["camera"])
        for c in screen["candidates"]
    ]
    ranked = sorted(entries, key=lambda entry: -entry[0])[:RANKED]
    kinds = {name: "camera" if camera else "physics" for _, name, _, _, camera in ranked}
    bars = [(factor, name, readable, signature) for factor, name, readable, signature, _ in ranked]
    bars += [(found["log_bayes_factor"], name, *DISCREPANCIES[name]) for name, found in screen["discrepancies"].items()]
    bars.sort(key=lambda bar: -bar[0])
    most = 1.08 * max([bar[0] for bar in bars] + [screen["threshold"]])
    rows = []
    for factor, name, readable, signature in bars:
        passed = " passed" if factor >= screen["threshold"] else ""
        linear = "" if name in refitted else " linear"
        tag = "added" if name == done["accepted"] else "not separated" if name in done["alike"] else ""
        rows.append(
            f'<div class="rank {kinds.get(name, "discrepancy")}{passed}{linear}" title="{text(signature)}">'
            f"<span>{text(readable)}{f'<em>{tag}</em>' if tag else ''}</span>"
            f'<div><i style="width:{share(factor, most)}"></i>'
            f'<s style="left:{share(screen["threshold"], most)}"></s></div><b>{signed(factor)}</b></div>'
        )
    return f'<div class="ranking">{"".join(rows)}</div>{_legend(screen, bool(refitted))}'


def _legend(screen: Mapping[str, Any], refitted: bool) -> str:
    threshold = screen["threshold"]
    bars = "strong colour: fitted again; pale: linear estimate" if refitted else "pale: linear estimate"
    return (
        '<p class="legend"><span><span class="key physics"></span>physics</span>'
        '<span><span class="key camera"></span>camera fault</span>'
        '<span><span class="key discrepancy"></span>no known effect</span>'
        f"<span>{bars}</span></p>"
        f'<p class="note">Dashed: {threshold:.1f} (odds of {words.odds(threshold)}), which the best of all passes by '
        f"chance in {screen['level']:.0%} of the recordings in which nothing is missing. Every 2.3 are a factor of "
        "ten in the odds; below 0 the recording speaks against an effect.</p>"
    )


def confounding(screen: Mapping[str, Any] | None) -> str:
    """How similar the signatures of the best candidates are: a table of shades."""
    if screen is None or not screen["candidates"]:
        return '<p class="muted">No effect has been tried.</p>'
    shown = screen["candidates"][:CONFOUNDED]
    head = ["", *(str(k + 1) for k in range(len(shown)))]
    rows = []
    for i, candidate in enumerate(shown):
        cells = "".join(_correlation(screen["correlations"][i][j], i == j) for j in range(len(shown)))
        rows.append(f"<tr><th><span>{i + 1}</span> {text(candidate['readable'])}</th>{cells}</tr>")
    return table(head, rows, "matrix")


def _correlation(value: float, same: bool) -> str:
    size = abs(value)
    shade = "" if same else f' style="--share:{size:.2f}"'
    mark = "" if same else f"{round(100 * size)}" if size >= 0.5 else ""
    kind = "same" if same else "confounded" if size >= INDISTINGUISHABLE else ""
    return f'<td class="{kind}"{shade} title="{value:+.2f}">{mark}</td>'


def refit_table(done: Mapping[str, Any]) -> str:
    """Every effect that was fitted with all other parameters, the most probable first."""
    if not done["refits"]:
        return '<p class="muted">No effect reached the range in which it could win, so none was fitted again.</p>'
    known = {parameter["name"] for parameter in done["parameters"]}
    order = sorted(done["refits"], key=lambda again: (again["name"] != done["accepted"], -again["log_odds"]))
    head = ["effect", "cost without → with", "log Bayes factor", "odds to none", "p", "coefficient (90 %)", "outcome"]
    rows = "".join(_refit(again, done, known) for again in order)
    said = words.indistinguishable(done)
    note = "Of the effects with a p below the level, the one that is most probable relative to the others is added."
    return table(head, [rows], "refits") + f'<p class="note">{text(f"{note} {said}".strip())}</p>'


def _refit(again: Mapping[str, Any], done: Mapping[str, Any], known: set[str]) -> str:
    own = [value for name, value in again["values"].items() if name not in known]
    coefficients = "".join(
        f"<div>{interval_text(one, one['unit'])}<small>{text(one['label'])}</small></div>" for one in own
    )
    notes = "".join(f"<small class=warn>{text(note)}</small>" for note in again["notes"])
    kind = "accepted" if again["name"] == done["accepted"] else ""
    p, factor = again["p_value"], again["log_bayes_factor"]
    return (
        f'<tr class="{kind}"><td class="name" title="{text(again["signature"])}"><b>{text(again["readable"])}</b></td>'
        f"<td>{again['cost_without']:.0f} → {again['cost']:.0f}</td><td>{signed(factor)}</td>"
        f"<td>{words.odds(factor, short=True)}</td><td>{'&lt; 0.0001' if p < 1e-4 else f'{p:.2g}'}</td>"
        f'<td>{coefficients}</td><td class="outcome">{outcome(again, done)}{notes}</td></tr>'
    )


def outcome(again: Mapping[str, Any], done: Mapping[str, Any]) -> str:
    """What became of an effect that was fitted."""
    name, level = again["name"], done["screen"]["level"]
    if name == done["accepted"]:
        return "added"
    if name in done["alike"]:
        return "not separated from the added one"
    if again["p_value"] >= level:
        return f"p above {level:.0%}: chance explains it"
    added = next((one for one in done["refits"] if one["name"] == done["accepted"]), again)
    behind = added["log_odds"] - again["log_odds"]
    if behind >= DECISIVE:
        return f"{words.odds(behind, short=True)} for the added one"
    return "a fault of a held-out camera, compared separately" if again["camera"] else "not added"
