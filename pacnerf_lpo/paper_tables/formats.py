"""A table as Markdown, CSV and LaTeX."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.paper_tables.tables import Entry, Row, Table

FAILED = "failed: "
MARKDOWN = {"best": "**{}**", "second": "<u>{}</u>", "": "{}"}
LATEX = {"best": r"\textbf{{{}}}", "second": r"\underline{{{}}}", "": "{}"}
LEGEND = "Best **bold**, second best <u>underlined</u>, of each baseline's columns; in brackets what the paper prints."
TEX = {"↑": r"$\uparrow$", "↓": r"$\downarrow$", "†": r"$^\dagger$", "_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#"}
TEX |= {power: f"$^{number}$" for number, power in enumerate("⁰¹²³⁴")}
TEX |= {
    letter: f"${name}$"
    for letter, name in zip("μκτηνθ", (r"\mu", r"\kappa", r"\tau", r"\eta", r"\nu", r"\theta"), strict=True)
}
TEX |= {"±": r"$\pm$"}


def write_table(table: Table, folder: Path) -> list[Path]:
    """Write ``NAME.md``, ``NAME.csv`` and ``NAME.tex``; returns their paths."""
    paths = []
    for suffix, text in ((".md", markdown(table)), (".csv", comma_separated(table)), (".tex", latex(table))):
        paths.append(folder / f"{table.name}{suffix}")
        write_atomically(paths[-1], text.encode())
    return paths


def markdown(table: Table) -> str:
    """The table with its legend and, under it, what is missing and why."""
    missing = _notes(table)
    lines = [f"## {table.title}", "", f"| {' | '.join((*table.head, *table.columns))} |"]
    lines.append("|---|---|" + "---:|" * len(table.columns))
    for row in table.rows:
        cells = [_cell(row, entry, MARKDOWN, missing) for entry in row.entries]
        lines.append(f"| {' | '.join((row.scene, row.quantity, *cells))} |")
    notes = [f"{number}: {_reason(note)}" for number, note in enumerate(missing, start=1)]
    keys = sorted({entry.key for row in table.rows for entry in row.entries if entry.key and entry.value is not None})
    notes += [*table.notes, f"Keys of the runs (their configurations are in `runs/`): {', '.join(keys) or 'none'}"]
    return "\n".join([*lines, "", LEGEND, *(f"\n{note}" for note in notes)]) + "\n"


def comma_separated(table: Table) -> str:
    """One line per figure: table, row, column, ours, deviation, the paper's, mark, note, key; numbers unrounded."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["table", *table.head, "column", "value", "deviation", "paper", "mark", "note", "key"])
    for row in table.rows:
        for column, entry in zip(table.columns, row.entries, strict=True):
            numbers = ["" if x is None else x for x in (entry.value, entry.deviation, entry.paper)]
            writer.writerow([table.name, row.scene, row.quantity, column, *numbers, entry.mark, entry.note, entry.key])
    return text.getvalue()


def latex(table: Table) -> str:
    """A ``tabular`` with booktabs' rules; the paper's figures in brackets."""
    missing = _notes(table)
    lines = [rf"% {table.title}", rf"\begin{{tabular}}{{ll{'r' * len(table.columns)}}}", r"\toprule"]
    lines.append(" & ".join(map(_tex, (*table.head, *table.columns))) + r" \\")
    lines[1:1] = [f"% {number}: {_reason(note)}" for number, note in enumerate(missing, start=1)]
    last = None
    for row in table.rows:
        if row.scene != last:
            lines.append(r"\midrule")
        cells = [_cell(row, entry, LATEX, missing).replace("±", r"$\pm$") for entry in row.entries]
        names = _tex(row.scene) if row.scene != last else "", _tex(row.quantity)
        lines.append(" & ".join((*names, *cells)) + r" \\")
        last = row.scene
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _notes(table: Table) -> list[str]:
    """Why figures are missing, each reason once; cells refer to them by number."""
    return list(dict.fromkeys(entry.note for row in table.rows for entry in row.entries if entry.value is None))


def _reason(note: str) -> str:
    return note if note.startswith(FAILED) else f"n/a ({note})"


def _cell(row: Row, entry: Entry, marks: Mapping[str, str], missing: list[str]) -> str:
    """``**28.91** (28.18)``, or ``n/a 1`` where the first note says why."""
    if entry.value is None:
        text = f"{'failed' if entry.note.startswith(FAILED) else 'n/a'} {missing.index(entry.note) + 1}"
    else:
        text = marks[entry.mark].format(row.printed(entry.value))
        text += "" if entry.deviation is None else f" ± {row.printed(entry.deviation)}"
    return text if entry.paper is None else f"{text} ({row.printed(entry.paper)})"


def _tex(text: str) -> str:
    return "".join(TEX.get(letter, letter) for letter in text)
