"""A table as data: rows of entries, ours next to the paper's, with the best and the second best of each row marked."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

Mark = Literal["", "best", "second"]


@dataclass(frozen=True)
class Entry:
    """One figure of a table.

    value: ours; None where there is none.
    note: why there is none.
    deviation: standard deviation where the value is a mean over view sets.
    paper: what the paper prints in this place.
    mark: among the compared columns of its row.
    key: of the run it comes from.
    """

    value: float | None = None
    note: str = ""
    deviation: float | None = None
    paper: float | None = None
    mark: Mark = ""
    key: str = ""


@dataclass(frozen=True)
class Row:
    """A line of a table.

    scene, quantity: what it is about, for people.
    form: how numbers are printed, such as ``.2f``.
    better: 1 higher, -1 lower, 0 not to be compared.
    """

    scene: str
    quantity: str
    form: str
    better: Literal[-1, 0, 1]
    entries: tuple[Entry, ...]

    def printed(self, value: float) -> str:
        """A number as this row prints it."""
        return format(value, self.form)


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
    entries = list(row.entries)
    for group in dict.fromkeys(filter(None, groups)):
        members = [i for i, name in enumerate(groups) if name == group and entries[i].value is not None]
        values = {i: float(row.printed(entries[i].value or 0.0)) for i in members}
        ranking = sorted(set(values.values()), reverse=row.better > 0)
        if row.better == 0 or len(members) < 2:
            continue
        marks: dict[float, Mark] = dict(zip(ranking, ("best", "second"), strict=False))
        for i in members:
            entries[i] = replace(entries[i], mark=marks.get(values[i], ""))
    return replace(row, entries=tuple(entries))
