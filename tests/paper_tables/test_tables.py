"""From the results of runs to the figures of a table and their marks."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

from pacnerf_lpo.paper_tables import layouts, tables
from pacnerf_lpo.paper_tables.layouts import ErrorLayout, ImageLayout, SpreadLayout, TimeLayout, ValueLayout
from pacnerf_lpo.paper_tables.plan import LABEL_FILE
from pacnerf_lpo.paper_tables.runner import Resources, run_all
from pacnerf_lpo.paper_tables.scores import Book, Figures
from pacnerf_lpo.paper_tables.tables import Column, Entry, Row, RunName, Table, marked
from tests.paper_tables.conftest import BASE, LPO, NONE, TORUS, Planner

FULL = Column("full view", "pac_nerf")
BASELINE = Column("3v", "3v", group="3v")
ONCE = Column("+LPO", "3v", "lpo", group="3v")
TWICE = Column("+LPO²", "3v", "lpo", 2, "3v")
NONE_TWICE = Column("+None²", "3v", "none", 2, "3v")
STATIC = Column("static", "3v", round=0, group="3v")
FULL_RUN = RunName("torus", "pac_nerf")


@pytest.fixture
def book(tmp_path: Path, plan: Planner, fake_fit: None) -> Book:
    runs = plan({BASE: 1, FULL_RUN: 1, LPO: 2, NONE: 2})
    return Book(runs, run_all(runs, tmp_path, Resources()))


def values(table: Table, quantity: str, scene: str = "torus") -> list[float | None]:
    row = next(row for row in table.rows if (row.scene, row.quantity) == (scene, quantity))
    return [entry.value for entry in row.entries]


def test_each_column_shows_its_phase_and_round(book: Book):
    """The stand-in gives 25 dB + 1 per round after identification, 27 + 1 after correction, 20 after static grids."""
    layout = ImageLayout("images", "", (FULL, STATIC, BASELINE, ONCE, TWICE, NONE_TWICE))
    table = layout.build(book, [TORUS])
    assert values(table, "PSNR↑ [dB]") == [26, 20, 26, 28, 29, 27]
    training = replace(layout, views="train").build(book, [TORUS])
    assert values(training, "PSNR↑ [dB]") == [28, 22, 28, 30, 31, 29]
    assert [entry.mark for entry in table.rows[0].entries] == ["", "", "", "second", "best", ""]


def test_a_run_that_saw_all_views_is_scored_on_those_the_others_hold_out(book: Book):
    results = book.runs[FULL_RUN].run_dir / "results.json"
    content = json.loads(results.read_text())
    content["views"] = {"train": [0, 2, 4, 8], "test": []}
    content["phases"][2]["images"]["psnr"] = [[10.0], [20.0], [30.0], [40.0]]  # views 0, 2, 4, 8
    results.write_text(json.dumps(content))
    table = ImageLayout("images", "", (FULL, BASELINE)).build(book, [TORUS])
    assert values(table, "PSNR↑ [dB]")[0] == 30.0  # of 2 and 8


def test_missing_lpips_is_a_reason_and_never_a_number(book: Book):
    table = ImageLayout("images", "", (BASELINE, ONCE)).build(book, [TORUS])
    assert values(table, "LPIPS↓") == [None, None]
    text = tables.markdown(table)
    assert "| torus | LPIPS↓ | n/a 1 | n/a 1 |" in text
    assert "1: n/a (torchvision is not installed)" in text
    assert "% 1: n/a (torchvision is not installed)" in tables.latex(table)


def test_parameters_and_their_errors(book: Book):
    table = ValueLayout("values", "", (BASELINE, TWICE)).build(book, [TORUS])
    assert table.columns[0] == "ground truth"
    assert values(table, "E [Pa]") == [1e6, 5e5, 2.5e5]
    errors = ErrorLayout("errors", "", (BASELINE, TWICE)).build(book, [TORUS])
    assert values(errors, "log10 E") == pytest.approx([0.301, 0.602])
    assert len(table.rows) == len(errors.rows) == 1
    assert errors.notes == [
        "+LPO² against 3v: closer to the truth in 0 of 1 items, farther by 0.301 at most",
    ]


def test_times_are_those_of_the_first_round_where_they_were_measured(book: Book):
    table = TimeLayout("times", "", (ONCE,)).build(book, [replace(TORUS)])
    seconds = [row.entries[0].value for row in table.rows]
    assert [row.quantity for row in table.rows] == ["1", "4", "12", "12", "1", ""]  # frames
    assert seconds == [10.0, 11.0, 12.0, 13.0, None, 46.0]  # the stand-in takes 10 s + 1 s per phase


def test_failed_and_missing_runs_say_so(tmp_path: Path, plan: Planner, fake_fit: None):
    (tmp_path / "control.json").write_text(json.dumps({"fail": ["torus-3v-lpo"]}))
    runs = plan({BASE: 1, LPO: 1, RunName("torus", "3v_dagger"): 1})
    book = Book(runs, run_all(runs[:2], tmp_path, Resources()))
    columns = (BASELINE, ONCE, Column("3v†", "3v_dagger", group="3v_dagger"))
    text = tables.markdown(ImageLayout("images", "", columns).build(book, [TORUS]))
    assert "| torus | PSNR↑ [dB] | 26.00 | failed 1 | n/a 2 |" in text
    assert "1: failed: |v| dt > dx (v = 310 m/s)" in text and "2: n/a (not run yet)" in text


def test_results_with_another_key_are_refused(book: Book):
    label = book.runs[BASE].run_dir / LABEL_FILE
    label.write_text(json.dumps({"key": "another"}))
    with pytest.raises(ValueError, match="another"):
        book.figures("torus", BASELINE)


def test_average_is_over_scenes_that_are_complete():
    rows = [
        Row(scene, "PSNR↑ [dB]", ".2f", 1, (Entry(a), Entry(b)))
        for scene, a, b in (("one", 20.0, 22.0), ("two", 30.0, 34.0), ("three", 90.0, None))
    ]
    layout = ImageLayout("images", "", (BASELINE, ONCE))
    average = layout._averages(rows, [replace(TORUS, name=row.scene) for row in rows])
    assert [row.scene for row in average] == ["average of one, two"]
    assert [entry.value for entry in average[0].entries] == [25.0, 28.0]


def test_the_paper_stands_beside_its_own_recordings_only(book: Book):
    columns = tuple(replace(BASELINE, label=str(i)) for i in range(5))
    layout = ImageLayout("table4", "", columns)
    ours = layout.build(book, [TORUS]).rows[0]
    theirs = layout.build(book, [replace(TORUS, original=True)]).rows[0]
    assert {entry.paper for entry in ours.entries} == {None}
    assert [entry.paper for entry in theirs.entries] == [25.17, 26.77, 25.33, 26.15, 26.55]  # Table 4, torus


def test_spread_over_view_sets(monkeypatch: pytest.MonkeyPatch):
    """Two scenes, two view sets: means 20 and 24, so 22 with deviation 2."""
    level = {("a", ""): 18.0, ("b", ""): 22.0, ("a", "3v_2"): 23.0, ("b", "3v_2"): 25.0}

    class Levels(Book):
        def figures(self, scene: str, column: Column, views: str = "") -> Figures:
            images = {"psnr": [[level[scene, views]]], "ssim": [[1.0]], "lpips": [[0.5]]}
            return Figures({"views": {"train": [], "test": [3]}}, {"images": images}, "key")

    layout = SpreadLayout("table13", "", (BASELINE,), view_sets=("", "3v_2"))
    scenes = [replace(TORUS, name=name) for name in "ab"]
    entry = layout.build(Levels([], {}), scenes).rows[0].entries[0]
    assert (entry.value, entry.deviation) == (22.0, 2.0)
    assert layout.view_sets == ("", "3v_2")


def test_best_and_second_best_of_each_group_as_printed():
    entries = tuple(Entry(value) for value in (9.0, 1.004, 2.0, 2.001, 1.2, None, 5.0, 4.0))
    groups = ["", *["one"] * 5, *["two"] * 2]
    higher = marked(Row("", "", ".2f", 1, entries), groups)
    assert [entry.mark for entry in higher.entries] == ["", "", "best", "best", "second", "", "best", "second"]
    lower = marked(Row("", "", ".2f", -1, entries), groups)
    assert [entry.mark for entry in lower.entries] == ["", "best", "", "", "second", "", "second", "best"]
    assert marked(Row("", "", ".2f", 0, entries), groups).entries == entries


def example() -> Table:
    best = Entry(28.9123, paper=28.18, mark="best", key="k2")
    row = Row("torus", "PSNR↑ [dB]", ".2f", 1, (Entry(26.4, mark="second", deviation=0.434, key="k1"), best))
    return Table("table5", "Title", ("PAC-NeRF-3v†", "+LPO"), [row], ["a note"])


def test_markdown():
    lines = tables.markdown(example()).splitlines()
    assert lines[4] == "| torus | PSNR↑ [dB] | <u>26.40</u> ± 0.43 | **28.91** (28.18) |"
    assert "a note" in lines
    assert lines[-1].endswith("k1, k2")


def test_csv_keeps_all_digits():
    rows = list(csv.DictReader(io.StringIO(tables.comma_separated(example()))))
    assert [(row["column"], float(row["value"]), row["paper"], row["mark"], row["key"]) for row in rows] == [
        ("PAC-NeRF-3v†", 26.4, "", "second", "k1"),
        ("+LPO", 28.9123, "28.18", "best", "k2"),
    ]


def test_latex():
    text = tables.latex(example())
    assert r"torus & PSNR$\uparrow$ [dB] & \underline{26.40} $\pm$ 0.43 & \textbf{28.91} (28.18) \\" in text
    assert r"PAC-NeRF-3v$^\dagger$" in text
    assert not [letter for letter in text if ord(letter) > 127]


def test_parameters_are_printed_with_the_names_of_the_tables():
    assert set(layouts.PARAMETERS) == {"mu", "kappa", "E", "tau_y", "eta", "nu", "theta"}
    lines = tables.latex(
        Table("t", "", ("c",), [Row("s", label, "", 0, ()) for label, *_ in layouts.PARAMETERS.values()])
    )
    assert not [letter for letter in lines if ord(letter) > 127]
