"""Results of the steps on disk: arrays and JSON, never code."""

from __future__ import annotations

import dataclasses
import io
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import store
from pacnerf_lpo.diagnosis.residual_force import ResidualForce
from pacnerf_lpo.diagnosis.screening import Probes
from pacnerf_lpo.diagnosis.store import RECORDS, Store, packed, read
from pacnerf_lpo.inference.checks import Prediction
from pacnerf_lpo.inference.force_law import Law, Term
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.intervals import Interval, Profile
from tests.diagnosis.examples import comparison, refit

TERM = Term("-v", 1.5, "1/s", 1.4, 1.6, 1.0, 0.9)
HYPOTHESIS = Hypothesis("LinearDrag", (np.ones((3, 1)), np.zeros((3, 1))), (np.array([2.0]), np.array([0.5])), True)
EXAMPLES = [
    comparison(),
    comparison().errors,
    Interval("E", 1e5, 9e4, np.inf, 5e3, False),
    Law([TERM], 0.8),
    Prediction(12.5, -3.0),
    Profile(1.0, 2.0, False, True, [(1.0, 2.5), (1.5, 2.0)]),
    refit("CameraShift@3"),
    ResidualForce(np.arange(3.0), np.ones((3, 3)), np.ones((3, 4, 3)), Law([TERM], 0.8), 0.7),
    HYPOTHESIS,
    Probes([HYPOTHESIS], [], 7),
    TERM,
]


def same(one: Any, other: Any) -> bool:
    """Equal in types and values, NaN included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


def test_there_is_an_example_of_every_record():
    assert {type(example).__name__ for example in EXAMPLES} == set(RECORDS)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: type(example).__name__)
def test_a_record_comes_back_as_it_was(example: Any, tmp_path: Path):
    path = tmp_path / "x.npz"
    path.write_bytes(packed(example))
    assert same(read(path), example)
    with np.load(path, allow_pickle=False) as arrays:  # raises for an array of objects
        assert all(arrays[name].dtype != object for name in arrays.files)


@pytest.mark.parametrize("value", [None, ["free fall", "impact"], (1.0, 2.0, {"a": [True, np.ones(2)]}), {}])
def test_so_does_what_is_no_record(value: Any, tmp_path: Path):
    path = tmp_path / "x.npz"
    path.write_bytes(packed(value))
    assert same(read(path), value)


def test_a_step_is_done_once_for_the_same_inputs_and_options(tmp_path: Path):
    done: list[int] = []

    def step() -> list[float]:
        done.append(1)
        return [1.0, 2.0]

    for options, expected in (({"seed": 1}, 1), ({"seed": 1}, 1), ({"seed": 2}, 2)):
        assert Store(tmp_path, b"run", options).once("1_screen", step) == [1.0, 2.0]
        assert len(done) == expected
    Store(tmp_path, b"another run", {"seed": 1}).once("1_screen", step)
    Store(tmp_path, b"run", {"seed": 1}).once("2_screen", step)
    assert len(done) == 4


def test_another_list_of_candidates_takes_over_what_depends_on_none(tmp_path: Path):
    done: list[str] = []
    for listed in (None, "- class_path: LinearDrag", "- class_path: Magnus"):
        store = Store(tmp_path, b"run", {}, listed)
        store.once("1_compare", lambda: done.append("compare"), of_any_list=True)
        store.once("1_probe", lambda: done.append("probe"))
        store.once("1_probe", lambda: done.append("probe"))
    assert done == ["compare", "probe", "probe", "probe"]


def test_the_seconds_of_a_step_are_those_of_the_run_that_did_it(tmp_path: Path):
    first = Store(tmp_path, b"run", {})
    first.once("1_compare", lambda: time.sleep(0.05))
    again = Store(tmp_path, b"run", {})
    again.once("1_compare", lambda: None)
    assert again.seconds == first.seconds and 0.05 <= again.seconds["1_compare"] < 60


def test_another_algorithm_does_not_take_over_what_this_one_has_found(tmp_path: Path, monkeypatch):
    before = Store(tmp_path, b"run", {}).key
    monkeypatch.setattr(store, "SCHEMA", store.SCHEMA + 1)
    assert Store(tmp_path, b"run", {}).key != before


class Malicious:
    """Whoever loads its pickle creates a file."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def damaged_files(evil: Path) -> dict[str, bytes]:
    whole = packed(comparison())
    objects = io.BytesIO()
    np.savez(objects, structure=np.array('{"array": "a0"}'), a0=np.array([Malicious(evil)], dtype=object))
    return {
        "empty": b"",
        "cut short": whole[: len(whole) // 2],
        "text": b"not an archive",
        "a pickle": pickle.dumps(Malicious(evil)),
        "an archive with a pickle": objects.getvalue(),
    }


@pytest.mark.parametrize("what", ["empty", "cut short", "text", "a pickle", "an archive with a pickle"])
def test_a_damaged_file_is_made_again_and_a_pickle_never_loaded(what: str, tmp_path: Path):
    evil, made = tmp_path / "evil", Store(tmp_path, b"run", {})
    made.once("1_screen", lambda: [1.0])
    (path,) = (tmp_path / "steps").iterdir()
    path.write_bytes(damaged_files(evil)[what])
    assert made.once("1_screen", lambda: [2.0]) == [2.0]
    assert read(path)["result"] == [2.0] and not evil.exists()


@pytest.mark.slow
def test_no_single_wrong_byte_is_a_traceback(tmp_path: Path):
    """At 150 places: the archive tells, or what is read has the same keys; either way a result comes back."""
    made, expected = Store(tmp_path, b"run", {}), {"a": np.arange(40.0), "b": [1.0, "x"]}
    made.once("1_screen", lambda: expected)
    (path,) = (tmp_path / "steps").iterdir()
    whole, random = path.read_bytes(), np.random.default_rng(0)
    for place in random.choice(len(whole), 150, replace=False):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ int(random.integers(1, 256))]) + whole[place + 1 :])
        assert same(made.once("1_screen", lambda: expected), expected), place


@pytest.mark.parametrize(
    "structure",
    ['{"record": "Path", "fields": {}}', '{"record": "Term", "fields": {"nonsense": 1}}', '{"array": "a7"}', "[", "{}"],
)
def test_what_no_step_has_written_is_made_again(structure: str, tmp_path: Path):
    made = Store(tmp_path, b"run", {})
    made.once("1_screen", lambda: [1.0])
    (path,) = (tmp_path / "steps").iterdir()
    with open(path, "wb") as file:
        np.savez(file, structure=np.array(structure))
    assert made.once("1_screen", lambda: [2.0]) == [2.0]


def test_a_pickle_of_an_older_version_beside_the_results_is_not_opened(tmp_path: Path):
    evil, made = tmp_path / "evil", Store(tmp_path, b"run", {})
    (tmp_path / "steps").mkdir()
    for name in (f"{made.key}_1_screen.pickle", f"{made.key}_1_screen.pkl", f"{made.key}_1_screen"):
        (tmp_path / "steps" / name).write_bytes(pickle.dumps(Malicious(evil)))
    assert made.once("1_screen", lambda: [2.0]) == [2.0]
    assert not evil.exists()
