"""What a table compares, cells that are each one scene under one baseline, correction and round; and the table as data,
Markdown, CSV and LaTeX, ours next to the paper's, with the best and the second best of each row marked.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import yaml

from pacnerf_lpo.manifest import write_atomically

NO_CORRECTION = "none"
Mark = Literal["", "best", "second"]
FAILED = "failed: "
MARKDOWN = {"best": "**{}**", "second": "<u>{}</u>", "": "{}"}
LATEX = {"best": r"\textbf{{{}}}", "second": r"\underline{{{}}}", "": "{}"}
LEGEND = "Best **bold**, second best <u>underlined</u>, of each baseline's columns; in brackets what the paper prints."
GREEK = {"μ": r"\mu", "κ": r"\kappa", "τ": r"\tau", "η": r"\eta", "ν": r"\nu", "θ": r"\theta"}  # noqa: RUF001
TEX = str.maketrans(
    {"↑": r"$\uparrow$", "↓": r"$\downarrow$", "†": r"$^\dagger$", "±": r"$\pm$"}
    | {"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#"}
    | {power: f"$^{number}$" for number, power in enumerate("⁰¹²³⁴")}
    | {letter: f"${name}$" for letter, name in GREEK.items()}
)
AVERAGE = "average"


@dataclass(frozen=True)
class Column:
    """One column of a table: its heading, files in ``configs/baselines`` and ``configs/corrections``, and the round of
    Algorithm 1 after which it is; 0 is the static phase. Columns of one group are compared with each other; an empty
    group is a reference.
    """

    label: str
    baseline: str
    correction: str = NO_CORRECTION
    round: int = 1
    group: str = ""

    @property
    def phase(self) -> str:
        """The phase whose images the column shows."""
        if self.round == 0:
            return "static"
        return "physics" if self.correction == NO_CORRECTION else "correction"


@dataclass(frozen=True, order=True)
class RunName:
    """Which run of a suite: the results after every round come out of one run, so the round is not part of it.

    No ``correction`` is the common beginning of all of them: static grids, velocity and the first identification, which
    is also the baseline's own result. No ``views``, a file in ``configs/views``, are the baseline's own.
    """

    scene: str
    baseline: str
    correction: str = ""
    views: str = ""

    @property
    def beginning(self) -> "RunName":
        """The run it starts from; itself when it is a beginning."""
        return RunName(self.scene, self.baseline, "", self.views)

    def __str__(self) -> str:
        parts = (self.scene, self.baseline, self.views, self.correction or "baseline")
        return " ".join(part for part in parts if part)


def run_of(scene: str, column: Column, views: str = "") -> RunName:
    """The run in which a column's figures for a scene are found; +None of the first round is the baseline itself."""
    begins = column.correction == NO_CORRECTION and column.round <= 1
    return RunName(scene, column.baseline, "" if begins else column.correction, views)


@dataclass(frozen=True)
class Entry:
    """One figure of a table: our value, or a note why there is none; the standard deviation, where it is a mean over
    view sets; what the paper prints in this place; the mark among the compared columns; and the key of its run.
    """

    value: float | None = None
    note: str = ""
    deviation: float | None = None
    paper: float | None = None
    mark: Mark = ""
    key: str = ""


@dataclass(frozen=True)
class Row:
    """A line of a table: what it is about, for people; how numbers are printed, such as ``.2f``; and whether higher (1)
    or lower (-1) is better, or they are not to be compared (0).
    """

    scene: str
    quantity: str
    form: str
    better: Literal[-1, 0, 1]
    entries: tuple[Entry, ...]


@dataclass
class Table:
    """A table with its columns, the groups in which they are compared, and notes under it."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    head: tuple[str, str] = ("scene", "")


def marked(row: Row, groups: Sequence[str]) -> Row:
    """Mark the best and the second best of each named group of columns; equal as printed is equal."""
    if row.better == 0:
        return row
    entries = list(row.entries)
    for group in dict.fromkeys(filter(None, groups)):
        members = [i for i, name in enumerate(groups) if name == group and entries[i].value is not None]
        values = {i: float(format(entries[i].value or 0.0, row.form)) for i in members}
        ranking = sorted(set(values.values()), reverse=row.better > 0)
        if len(members) < 2:
            continue
        marks: dict[float, Mark] = dict(zip(ranking, ("best", "second"), strict=False))
        for i in members:
            entries[i] = replace(entries[i], mark=marks.get(values[i], ""))
    return replace(row, entries=tuple(entries))


def write_table(table: Table, folder: Path) -> None:
    """Write ``NAME.md``, ``NAME.csv`` and ``NAME.tex``."""
    for suffix, text in ((".md", markdown(table)), (".csv", comma_separated(table)), (".tex", latex(table))):
        write_atomically(folder / f"{table.name}{suffix}", text.encode())


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
    lines.append(" & ".join(name.translate(TEX) for name in (*table.head, *table.columns)) + r" \\")
    lines[1:1] = [f"% {number}: {_reason(note)}" for number, note in enumerate(missing, start=1)]
    last = None
    for row in table.rows:
        if row.scene != last:
            lines.append(r"\midrule")
        cells = [_cell(row, entry, LATEX, missing).replace("±", r"$\pm$") for entry in row.entries]
        names = row.scene.translate(TEX) if row.scene != last else "", row.quantity.translate(TEX)
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
        text = marks[entry.mark].format(format(entry.value, row.form))
        text += "" if entry.deviation is None else f" ± {entry.deviation:{row.form}}"
    return text if entry.paper is None else f"{text} ({entry.paper:{row.form}})"


@cache
def _content() -> dict[str, Any]:
    """What the paper's supplement prints."""
    return yaml.safe_load((files("pacnerf_lpo.paper_tables") / "paper.yaml").read_text(encoding="utf-8"))


def paper_truth(scene: str) -> dict[str, float]:
    """Ground truth of one of the paper's scenes by this project's names [SI, degrees]."""
    return dict(_content()["truth"][scene])


def paper_values(table: str, scene: str, quantity: str) -> Sequence[float | None]:
    """A row of ``table4`` ... ``table16``, one value per column; empty where the paper has no such row. A scene may be
    ``average`` or ``deviation``; a quantity is ``psnr``, ``ssim``, ``lpips``, a parameter, or a process of Table 9.
    """
    return _content().get(table, {}).get(scene, {}).get(quantity, [])
