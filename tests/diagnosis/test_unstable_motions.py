"""Whole diagnoses in which some motions are unstable: each ends with a verdict or one error about a base model."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import diagnose
from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.diagnose import Options, investigate
from pacnerf_lpo.diagnosis.removal import Without
from pacnerf_lpo.diagnosis.rounds import Round, verdict
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from tests.diagnosis import falling

KINDS = {"nothing", "missing", "camera", "unknown", "unfinished"}


def diagnosed(folder: Path, drag: float = 2.0) -> list[Round]:
    options = Options(falling.listed(folder), replicates=5, effects=1)
    problem = falling.Falling({"drag": drag} if drag else {})
    return investigate(problem, Store(folder, b"falling", {}), options, lambda _: None)


def by_call(share: float, seed: int):
    """Any call may fail, the same point now and not the next time, as a failure of another process does."""
    random = np.random.default_rng(seed)
    return lambda model, free: random.random() < share


def by_point(share: float, seed: int):
    """Some points are unstable, and remain so."""

    def unstable(model: Model, free: np.ndarray) -> bool:
        point = np.round(free, 9).tobytes() + f"{seed} {model.body.spacing:.9f} {model.names}".encode()
        return zlib.crc32(point) < share * 2**32

    return unstable


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("kind", "share"), [(by_call, 0.05), (by_call, 0.15), (by_point, 0.1)])
def test_a_diagnosis_ends_with_a_verdict_or_one_clear_error(kind, share, seed, tmp_path, monkeypatch, small_threads):
    failed = []
    unstable = kind(share, seed)

    def counted(model: Model, free: np.ndarray) -> bool:
        failed.append(unstable(model, free))
        return failed[-1]

    falling.install(monkeypatch, counted)
    try:
        found = verdict(diagnosed(tmp_path))
    except SimulationError:
        found = None
    assert any(failed)
    assert found is None or found.kind in KINDS


@pytest.mark.slow
def test_a_diagnosis_of_what_is_stable_names_the_drag(tmp_path, monkeypatch, small_threads):
    falling.install(monkeypatch)
    rounds = diagnosed(tmp_path)
    found = verdict(rounds)
    assert (found.kind, found.names, found.more_than_noise) == ("missing", ["LinearDrag"], False)
    (drag,) = (interval for interval in rounds[-1].parameters if interval.name == "drag")
    assert drag.value == pytest.approx(2.0, abs=0.1) and drag.high - drag.low < 0.3
    assert rounds[-1].estimate is not None and "estimate" in rounds[-1].effort


@pytest.mark.slow
def test_a_hypothesis_that_is_never_stable_is_left_out(tmp_path, monkeypatch, small_threads):
    """Drag cannot be simulated: the diagnosis ends without it."""
    falling.install(monkeypatch, lambda model, _: "drag" in model.names)
    found = verdict(diagnosed(tmp_path))
    assert "LinearDrag" not in found.names and found.kind in KINDS


def test_an_effect_whose_model_cannot_be_examined_is_left_out_and_said_to_be(tmp_path, monkeypatch, small_threads):
    """Drag is found, but replicates with it, on finer grids, are unstable: the verdict comes without it."""
    fine = 0.95 * falling.SPACING
    falling.install(monkeypatch, lambda model, _: "drag" in model.names and model.body.spacing < fine)
    rounds = diagnosed(tmp_path)
    assert "LinearDrag" not in verdict(rounds).names
    assert rounds[0].left_out["LinearDrag"] == "simulation stopped in frame 3, substep 1: made unstable by a test"
    again = diagnosed(tmp_path)  # from what was stored
    assert (verdict(again), again[0].left_out) == (verdict(rounds), rounds[0].left_out)


@pytest.mark.slow
def test_what_fell_behind_is_tried_once_the_best_is_left_out(tmp_path, monkeypatch, small_threads):
    """Beside strong drag, wind is not worth a fit; where drag cannot be examined, it is."""
    falling.install(monkeypatch)
    (tmp_path / "stable").mkdir()
    stable = diagnosed(tmp_path / "stable", drag=4.0)
    assert "UniformForce" not in [again.name for again in stable[0].refits]
    fine = 0.95 * falling.SPACING
    falling.install(monkeypatch, lambda model, _: "drag" in model.names and model.body.spacing < fine)
    rounds = diagnosed(tmp_path, drag=4.0)
    assert list(rounds[0].left_out) == ["LinearDrag"]
    assert "UniformForce" in [again.name for again in rounds[0].refits]


def test_an_effect_stays_where_the_model_without_it_is_unstable(tmp_path, monkeypatch, small_threads):
    """Drag and wind are found; what would then be removed, stays, with the reason."""
    left = []
    falling.install(monkeypatch, lambda *_: bool(left))

    def without_each(problem: falling.Falling, found: Round) -> list[Without]:
        left.append(found.effects[0])
        return [Without(name_of(left[0]), left[0], found.comparison.known, superfluous=True)]

    monkeypatch.setattr(diagnose, "without_each", without_each)
    problem = falling.Falling({"drag": 2.0, "push_x": 3.0, "push_z": 0.0})
    options = Options(falling.listed(tmp_path), replicates=5, effects=2)
    rounds = diagnose.investigate(problem, Store(tmp_path, b"falling", {}), options, lambda _: None)
    assert set(verdict(rounds).names) == {"LinearDrag", "UniformForce"}
    assert rounds[-1].left_out == {
        name_of(left[0]): "simulation stopped in frame 3, substep 1: made unstable by a test"
    }
    assert rounds[-1].estimate is None and rounds[-1].best is rounds[-1].comparison


def test_a_base_model_that_is_never_stable_is_one_error(tmp_path, monkeypatch, small_threads):
    falling.install(monkeypatch, lambda *_: True)
    with pytest.raises(SimulationError, match="unstable from every start of the base fit"):
        diagnosed(tmp_path)
