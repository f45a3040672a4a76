"""Small pieces of HTML that the parts of a diagnosis' page share."""

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pacnerf_lpo.quantities import quantity, symbol
from pacnerf_lpo.report.wording import capitalised

text = html.escape


def table(head: Sequence[str], rows: Sequence[str], kind: str = "") -> str:
    """A table; the head and the rows are HTML."""
    cells = "".join(f"<th>{title}</th>" for title in head)
    named = f' class="{kind}"' if kind else ""
    return f"<table{named}><thead><tr>{cells}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def row(cells: Sequence[str]) -> str:
    """A row of a table; the cells are HTML."""
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def bullets(sentences: Sequence[str]) -> str:
    """A list; nothing where there is none."""
    return f"<ul>{''.join(f'<li>{text(capitalised(s))}</li>' for s in sentences)}</ul>" if sentences else ""


def paragraphs(sentences: Sequence[str]) -> str:
    """One for each sentence."""
    return "".join(f"<p>{text(sentence)}</p>" for sentence in sentences)


def shown(value: float, unit: str) -> str:
    """A value with its unit, or infinity; powers and the minus sign as in print."""
    size = text(quantity(abs(value), unit)).replace("^2", "²").replace("^3", "³") if math.isfinite(value) else "∞"
    return f"&minus;{size}" if value < 0 else size


def signed(value: float) -> str:
    """With one digit and a true minus sign."""
    return f"{value if abs(value) >= 0.05 else 0.0:.1f}".replace("-", "&minus;")


def interval_text(found: Mapping[str, Any] | None, unit: str) -> str:
    """A value, its 90 % interval, and whether it is determined."""
    if found is None:
        return "<span class=muted>none</span>"
    ends = f"{shown(found['low'], unit)} … {shown(found['high'], unit)}"
    sure = "" if found["identifiable"] else "<small>not determined</small>"
    return f"<b>{shown(found['value'], unit)}</b><small>{ends}</small>{sure}"


def value_text(found: Mapping[str, Any] | None, unit: str) -> str:
    """A value alone."""
    return "none" if found is None else shown(found["value"], unit)


def symbol_html(name: str) -> str:
    """The usual symbol; nothing where a parameter has only a name."""
    head, _, tail = symbol(name).partition("_")
    if len(head) > 1 or len(tail) > 2:
        return ""
    return f"{text(head)}<sub>{text(tail)}</sub>" if tail else text(head)


def share(value: float, most: float) -> str:
    """A length on an axis that ends at ``most``, as CSS has it."""
    return f"{100 * min(max(value / max(most, 1e-12), 0.0), 1.0):.1f}%"
