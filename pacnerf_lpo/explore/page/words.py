"""Values, evidence and differences as a person reads them."""

import math

from pacnerf_lpo.explore.page.charts import chart
from pacnerf_lpo.explore.records import Setting, Suggestion
from pacnerf_lpo.explore.session import Session
from pacnerf_lpo.mpm.parameters import OF
from pacnerf_lpo.quantities import figure, quantity, symbol
from pacnerf_lpo.report.wording import capitalised, listed, probability, readable

MOST_SIZES = 2
"""Coefficients of a suggestion that are written out: two lines each are read, more are not."""


def short(setting: Setting) -> str:
    """``E = 97 kPa`` or, where a box next to it shows the value, ``v_x [m/s]``."""
    own, _, recording = setting.name.partition(OF)
    name = f"{symbol(own)} {recording}" if recording else symbol(own)
    if setting.logarithmic:
        return f"{name} = {quantity(setting.value, setting.unit)}"
    return name if setting.unit == "1" else f"{name} [{setting.unit}]"


def long(setting: Setting) -> str:
    """What a setting is, what it may be, and how well it is known."""
    text = f"{setting.label}, {quantity(setting.low, setting.unit)} to {quantity(setting.high, setting.unit)}"
    if setting.interval is not None:
        text += f"; 90 % interval of the last fit {between(setting.interval, setting.unit)}"
    return text + ("" if setting.fitted else "; cannot be fitted")


def between(interval: tuple[float, float], unit: str) -> str:
    """An interval with its unit."""
    return f"[{quantity(interval[0], unit)}, {quantity(interval[1], unit)}]"


def evidence(found: Suggestion) -> str:
    """How much an effect would help, and how large it would be, as a part of a page."""
    odds = found.log_bayes_factor / math.log(10.0)
    sizes = [
        f"{symbol(name)} ≈ {quantity(value, found.units[name])}"
        + (f" {between(found.intervals[name], found.units[name])}" if name in found.intervals else "")
        for name, value in found.values.items()
    ]
    sure, more = "stands out" if found.stands_out else "may be chance", len(sizes) - MOST_SIZES
    return chart("evidence", odds, probability(found.p_value), sure, sizes[:MOST_SIZES], more)


def reason(found: Suggestion) -> str:
    """What a video shows of an effect, what it is confused with, and what would decide."""
    text = capitalised(found.signature)
    if found.confused_with:
        text += f"; easily confused with {listed([readable(name) for name in found.confused_with])}"
    return f"{text}. To decide: {found.separating_experiment}." if found.separating_experiment else f"{text}."


def difference_table(session: Session, before: int, after: int) -> str:
    """What differs between two steps, and their errors, as a part of a page."""
    found = session.compare(before, after)
    units = {setting.name: setting.unit for setting in session.settings}
    show = lambda name, value: "\N{EN DASH}" if value is None else quantity(value, units.get(name, "1"))  # noqa: E731
    number = lambda value: figure(math.nan if value is None else value, found.unit)  # noqa: E731
    rows = [(name, show(name, a), show(name, b)) for name, (a, b) in found.changed.items()]
    for name, (a, b) in (("fitted error", found.fitted), ("held-out error", found.held_out)):
        rows.append((name, number(a), number(b)))
    return chart("differences", rows, before, after)
