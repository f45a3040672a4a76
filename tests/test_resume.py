"""A run that is cut in the middle of each of its phases ends with the same particles as one that is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.callbacks.phase import PhaseCheckpoint
from pacnerf_lpo.commands import fit as fit_command
from pacnerf_lpo.types import ParticleState

pytestmark = pytest.mark.slow

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SMOKE = Path(__file__).with_name("smoke.yaml")
TINY = (
    "--phases.static.init_args.length.init_args.halvings=1",  # before the cut
    "--phases.velocity.init_args.max_iterations=12",
    "--physics.substep_rate=480",
)
ADAM = ("PaperAdam", "--phases.physics.method.warm_up_iterations=2", "--phases.physics.method.main_iterations=2")
GAUSS_NEWTON = ("GaussNewton", "--phases.physics.method.coarse_iterations=2", "--phases.physics.method.iterations=2")
INTERRUPTED = 130


def fit(run_dir: Path, correction: str, method: tuple[str, ...], *options: str) -> int:
    names = [CONFIGS / "fit.yaml", CONFIGS / "demo.yaml", SMOKE, CONFIGS / "corrections" / f"{correction}.yaml"]
    files = [word for path in names for word in ("--config", str(path))]
    physics = [f"--phases.physics.method={method[0]}", *method[1:], "--phases.correction.init_args.iterations=2"]
    return main(["fit", *files, *TINY, *physics, *options, "--outer_loop.run_dir", str(run_dir)])


@pytest.fixture(autouse=True)
def no_evaluation(monkeypatch: pytest.MonkeyPatch, small_threads: None) -> None:
    monkeypatch.setattr(fit_command, "finish", lambda run_dir, truth: None)


@pytest.fixture
def cuts(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Cuts each phase once, in its middle: after how many steps, by phase."""
    counted: dict[str, int] = {}
    batch_end = PhaseCheckpoint.on_train_batch_end

    def on_train_batch_end(self: PhaseCheckpoint, trainer: Any, module: Any, outputs: Any, batch: Any, index: int):
        stem, last = self.path.parent.name, trainer.num_training_batches - 1
        if stem not in counted and index == last // 2:
            counted[stem] = index + 1
            self.stop.requested = True
        batch_end(self, trainer, module, outputs, batch, index)

    monkeypatch.setattr(PhaseCheckpoint, "on_train_batch_end", on_train_batch_end)
    return counted


@pytest.mark.parametrize(
    ("correction", "method", "options"),
    [
        ("lpo", ADAM, ()),
        ("go", GAUSS_NEWTON, ("--outer_loop.rounds=2", "--outer_loop.carry=refit_grid")),
    ],
    ids=["adam-lpo", "gauss_newton-go-refit"],
)
def test_cut_in_every_phase(
    tmp_path: Path, cuts: dict[str, int], correction: str, method: tuple[str, ...], options: tuple[str, ...]
):
    """To the last bit: each step draws from its own seed, and sums run in the same order on one thread."""
    cut, whole = tmp_path / "cut", tmp_path / "whole"
    status = fit(cut, correction, method, *options)
    while status == INTERRUPTED:
        status = main(["fit", "--resume", str(cut)])
    assert status == 0
    stems = [path.stem for path in sorted((cut / "states").iterdir())]
    assert sorted(cuts) == stems, "every phase must have been cut"
    assert fit(whole, correction, method, *options) == 0  # `cuts` remembers its phases, so nothing is cut any more
    for stem in stems:
        one, other = (ParticleState.load(run / "states" / f"{stem}.pt") for run in (cut, whole))
        assert one.physics == other.physics, stem
        for name in ("positions", "velocity", "density", "features"):
            assert torch.equal(getattr(one, name), getattr(other, name)), (stem, name)
        assert all(torch.equal(one.colour_network[key], value) for key, value in other.colour_network.items())
