"""What SECURITY.md says about files that are opened, and the files that greet a visitor."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from pickle import UnpicklingError

import numpy as np
import pytest
import pytorch_lightning as pl
import torch
import yaml
from torch.utils.data import DataLoader

from pacnerf_lpo import __version__
from pacnerf_lpo.__main__ import main
from pacnerf_lpo.diagnosis.store import read
from pacnerf_lpo.types import ParticleState

ROOT = Path(__file__).resolve().parents[1]


class Harmful:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark: Path):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


class Model(pl.LightningModule):
    """The smallest one that trains."""

    def __init__(self):
        super().__init__()
        self.layer = torch.nn.Linear(1, 1)

    def training_step(self, batch: torch.Tensor, index: int) -> torch.Tensor:
        return self.layer(batch).mean()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), 0.1)

    def train_dataloader(self) -> DataLoader:
        return DataLoader(torch.ones(1, 1))


def test_a_checkpoint_executes_nothing(tmp_path: Path):
    """As :mod:`pacnerf_lpo.cli` resumes: Lightning passes on no choice, and torch refuses what is no tensor."""

    def trainer(epochs: int) -> pl.Trainer:
        silent = {"enable_progress_bar": False, "enable_model_summary": False, "enable_checkpointing": False}
        return pl.Trainer(max_epochs=epochs, logger=False, accelerator="cpu", **silent)

    first = trainer(1)
    first.fit(Model())
    content = {**first._checkpoint_connector.dump_checkpoint(), "more": Harmful(tmp_path / "mark")}
    torch.save(content, tmp_path / "phase.ckpt")
    with pytest.raises(UnpicklingError, match="Weights only"):
        trainer(2).fit(Model(), ckpt_path=tmp_path / "phase.ckpt")
    assert not (tmp_path / "mark").exists()


def test_a_particle_state_executes_nothing(tmp_path: Path):
    torch.save({"positions": Harmful(tmp_path / "mark")}, tmp_path / "state.pt")
    with pytest.raises(UnpicklingError, match="Weights only"):
        ParticleState.load(tmp_path / "state.pt")
    assert not (tmp_path / "mark").exists()


def test_arrays_of_a_diagnosis_execute_nothing(tmp_path: Path):
    np.savez(tmp_path / "step.npz", structure=np.array([Harmful(tmp_path / "mark")], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        read(tmp_path / "step.npz")
    assert not (tmp_path / "mark").exists()


def test_a_class_path_executes_its_module_even_if_it_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "stranger.py").write_text("import os\nos.mkdir('mark')\n\nclass Thing:\n    pass\n")
    config = {"physics": {"material": {"class_path": "stranger.Thing"}}}
    (tmp_path / "stranger.yaml").write_text(yaml.safe_dump(config))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    assert main(["fit", "--config", "fit", "--config", "demo", "--config", "stranger.yaml", "--print_config"]) == 2
    assert (tmp_path / "mark").is_dir()


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__ and citation["license"] == "MIT"
    assert {"cff-version", "message", "title", "authors"} <= set(citation)


def test_every_issue_about_a_recording_asks_for_its_page():
    forms = [yaml.safe_load(path.read_text()) for path in (ROOT / ".github/ISSUE_TEMPLATE").glob("[0-9]*.yml")]
    assert len(forms) == 3
    for form in forms:
        assert {"name", "description", "body"} <= set(form)
        assert any("scene.html" in str(field["attributes"]) for field in form["body"]), form["name"]
