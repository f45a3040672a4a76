"""The paper's kinds of tables: which figures stand in which place."""

import statistics
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from pacnerf_lpo.paper_tables.scenes import Scene
from pacnerf_lpo.paper_tables.scores import Book, Figures
from pacnerf_lpo.paper_tables.tables import AVERAGE, Column, Entry, Row, Table, marked, paper_values, run_of

METRICS: tuple[tuple[str, str, str, Literal[-1, 1]], ...] = (
    ("psnr", "PSNR↑ [dB]", ".2f", 1),
    ("ssim", "SSIM↑", ".3f", 1),
    ("lpips", "LPIPS↓", ".3f", -1),
)
PARAMETERS = {
    "mu": ("log10 μ", "μ", ".3g"),
    "kappa": ("log10 κ", "κ [Pa]", ".3g"),
    "E": ("log10 E", "E [Pa]", ".3g"),
    "tau_y": ("log10 τ_Y", "τ_Y [Pa]", ".3g"),
    "eta": ("log10 η", "η [Pa s]", ".4g"),
    "nu": ("ν", "ν", ".3f"),  # noqa: RUF001
    "theta": ("θ [rad]", "θ [deg]", ".2f"),
}


@dataclass(frozen=True)
class Layout(ABC):
    """A table of the paper. ``name`` is its file, and its place in ``paper.yaml``; ``view_sets`` names the view sets
    that it needs, files in ``configs/views``; the empty name means the baselines' own views.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    view_sets: tuple[str, ...] = ("",)

    @abstractmethod
    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """The table as far as there are results."""

    def table(self, rows: Iterable[Row], columns: tuple[str, ...] | None = None) -> Table:
        """A table of rows whose best and second best are marked."""
        groups = [column.group for column in self.columns]
        labels = columns or tuple(column.label for column in self.columns)
        return Table(self.name, self.title, labels, [marked(row, groups) for row in rows])

    def beside_paper(self, scene: Scene, quantity: str, entries: Sequence[Entry]) -> tuple[Entry, ...]:
        """Our entries with what the paper prints in the same places, where the scene is the paper's."""
        return with_printed(entries, paper_values(self.name, scene.name, quantity) if scene.original else [])

    def by_parameter(self, book: Book, scenes: Sequence[Scene]) -> Iterator[tuple[Scene, str, list[Figures | Entry]]]:
        """Every scene with each parameter whose truth is known, in the paper's order, and its figures."""
        for scene in scenes:
            found = [book.figures(scene.name, column) for column in self.columns]
            known = {name for one in found if isinstance(one, Figures) for name in one.true_values()}
            yield from ((scene, name, found) for name in PARAMETERS if name in known)


@dataclass(frozen=True)
class ImageLayout(Layout):
    """PSNR, SSIM and LPIPS by scene and on average, of a set of views, and perhaps of the first frame only. A reference
    that was trained on all views is scored on those that the first compared column holds out.
    """

    views: Literal["train", "test"] = "test"
    first_frame: bool = False

    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """One row per scene and metric, then the averages over the scenes that have every figure."""
        rows = []
        for scene in scenes:
            cells = self._figures(book, scene.name)
            for name, label, form, better in METRICS:
                entries = [
                    one if isinstance(one, Entry) else one.image(name, views, self.first_frame) if views else NO_VIEWS
                    for one, views in cells
                ]
                rows.append(Row(scene.name, label, form, better, self.beside_paper(scene, name, entries)))
        return self.table([*rows, *self._averages(rows, scenes)])

    def _figures(self, book: Book, scene: str) -> list[tuple[Figures | Entry, list[int]]]:
        found = [book.figures(scene, column) for column in self.columns]
        pairs = zip(found, self.columns, strict=True)
        compared = (one.views(self.views) for one, column in pairs if isinstance(one, Figures) and column.group)
        held_out = next(compared, [])
        return [(one, one.views(self.views) or held_out if isinstance(one, Figures) else []) for one in found]

    def _averages(self, rows: Sequence[Row], scenes: Sequence[Scene]) -> list[Row]:
        averages = []
        for name, label, form, better in METRICS:
            mine = [row for row in rows if row.quantity == label]
            if len(mine) < 2:
                continue
            complete = [row for row in mine if all(entry.value is not None for entry in row.entries)]
            said = "average"
            if len(complete) < len(mine):
                said += f" of {', '.join(row.scene for row in complete) or 'none'}"
            whole = len(complete) == len(mine) == PAPER_SCENES and all(scene.original for scene in scenes)
            printed = paper_values(self.name, AVERAGE, name) if whole else []
            columns = zip(*(row.entries for row in complete), strict=True)
            means = [Entry(statistics.fmean(entry.value or 0.0 for entry in column)) for column in columns]
            none = [Entry(note="no scene is complete")] * len(self.columns)
            averages.append(Row(said, label, form, better, with_printed(means or none, printed)))
        return averages


NO_VIEWS = Entry(note="no such views")
PAPER_SCENES = 9


@dataclass(frozen=True)
class SpreadLayout(Layout):
    """Image metrics of a set of views averaged over scenes, as mean and standard deviation over several view sets."""

    views: Literal["train", "test"] = "test"

    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """One row per metric."""
        original, rows = sum(scene.original for scene in scenes) == PAPER_SCENES, []
        for name, label, form, better in METRICS:
            printed = paper_values(self.name, AVERAGE, name) if original else []
            entries = [self._over_sets(book, scenes, column, name) for column in self.columns]
            rows.append(Row("average", label, form, better, with_printed(entries, printed)))
        table = self.table(rows)
        names = ", ".join(name or "the baseline's own" for name in self.view_sets)
        table.notes.append(f"mean ± standard deviation (over n, not n - 1) of {len(self.view_sets)} view sets: {names}")
        return table

    def _over_sets(self, book: Book, scenes: Sequence[Scene], column: Column, name: str) -> Entry:
        means = []
        for views in self.view_sets:
            found = [book.figures(scene.name, column, views) for scene in scenes]
            entries = [one if isinstance(one, Entry) else one.image(name, one.views(self.views)) for one in found]
            missing = [entry for entry in entries if entry.value is None]
            if missing:
                return Entry(note=missing[0].note)
            means.append(statistics.fmean(entry.value for entry in entries if entry.value is not None))
        return Entry(statistics.fmean(means), deviation=statistics.pstdev(means))


@dataclass(frozen=True)
class ErrorLayout(Layout):
    """Distances of the identified parameters from the truth (appendix E.4)."""

    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """One row per scene and true parameter."""
        rows = []
        for scene, name, found in self.by_parameter(book, scenes):
            entries = [one if isinstance(one, Entry) else one.error(name) for one in found]
            rows.append(Row(scene.name, PARAMETERS[name][0], ".3f", -1, self.beside_paper(scene, name, entries)))
        table = self.table(rows)
        table.notes += self._counts(rows)
        return table

    def _counts(self, rows: Sequence[Row]) -> Iterator[str]:
        """In how many items each column is closer to the truth than the first of its group."""
        for i, column in enumerate(self.columns):
            first = next(j for j, other in enumerate(self.columns) if other.group == column.group)
            pairs = [(row.entries[i].value, row.entries[first].value) for row in rows]
            gains = [theirs - mine for mine, theirs in pairs if mine is not None and theirs is not None]
            if first < i and gains and column.group:
                closer = f"closer to the truth in {sum(gain > 0 for gain in gains)} of {len(gains)} items"
                farther = f"farther by {max(0.0, -min(gains)):.3f} at most"
                yield f"{column.label} against {self.columns[first].label}: {closer}, {farther}"


@dataclass(frozen=True)
class ValueLayout(Layout):
    """Identified parameters next to the true ones."""

    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """One row per scene and true parameter; the first column is the truth."""
        rows = []
        for scene, name, found in self.by_parameter(book, scenes):
            entries = [one if isinstance(one, Entry) else one.parameter(name) for one in found]
            true = [values[name] for one in found if isinstance(one, Figures) and name in (values := one.true_values())]
            row = (Entry(true[-1]), *self.beside_paper(scene, name, entries))
            rows.append(Row(scene.name, *PARAMETERS[name][1:], 0, row))
        return self.table(rows, ("ground truth", *(column.label for column in self.columns)))


@dataclass(frozen=True)
class TimeLayout(Layout):
    """Seconds per process of one round of Algorithm 1 (Table 9); its one column is a corrected run."""

    def build(self, book: Book, scenes: Sequence[Scene]) -> Table:
        """One row per process, one column per scene."""
        seconds = [self._seconds(book, scene) for scene in scenes]
        rows = []
        for process, label in PROCESSES.items():
            cells = zip(scenes, seconds, strict=True)
            entries = tuple(self.beside_paper(scene, process, [mine[process]])[0] for scene, mine in cells)
            rows.append(Row(label, self._frames(book, scenes, process), ".1f", 0, entries))
        table = self.table(rows, tuple(f"{scene.name} [s]" for scene in scenes))
        table.head = ("process", "# frames")
        table.notes.append("phases taken over from another run keep the seconds measured there")
        return table

    def _seconds(self, book: Book, scene: Scene) -> dict[str, Entry]:
        found = book.figures(scene.name, self.columns[0])
        if isinstance(found, Entry):
            return dict.fromkeys(PROCESSES, found)
        first = {phase["phase"]: phase["seconds"] for phase in found.results["phases"] if phase["round"] <= 1}
        known = {name: Entry(value, key=found.key) for name, value in first.items()}
        return {"colour": NO_COLOUR_PHASE, "total": Entry(sum(first.values()), key=found.key), **known}

    def _frames(self, book: Book, scenes: Sequence[Scene], process: str) -> str:
        if len(scenes) > 1:
            return ""
        config = book.runs[run_of(scenes[0].name, self.columns[0])].config
        frames = str(config["data"]["frames"] or "all")
        before_contact = str(config["phases"]["velocity"]["init_args"]["hit_frame"])
        return {"static": "1", "velocity": before_contact, "colour": "1", "total": ""}.get(process, frames)


PROCESSES = {
    "static": "(1) Eulerian static voxel grid optimization",
    "velocity": "(2a) Velocity optimization",
    "physics": "(2b, 2c) Warm-up and main optimization",
    "correction": "(3) Lagrangian particle optimization",
    "colour": "(4) Color prediction",
    "total": "sum",
}
NO_COLOUR_PHASE = Entry(note="the corrected particles go into the next round as they are")


def with_printed(entries: Sequence[Entry], printed: Sequence[float | None]) -> tuple[Entry, ...]:
    """Our entries with what the paper prints in the same places."""
    if not printed:
        return tuple(entries)
    return tuple(replace(entry, paper=value) for entry, value in zip(entries, printed, strict=True))
