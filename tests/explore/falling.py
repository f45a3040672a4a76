"""A session about a ball whose motion is computed for its centre alone, see ``tests/diagnosis/falling.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.source import Source
from pacnerf_lpo.identification.forward_model import MARGIN
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.study import StudyProblem
from pacnerf_lpo.mpm.effects import LinearDrag
from tests.diagnosis.falling import TRUTH, Falling, motion

DRAG = 2.0  # 1/s


def seen(hidden: dict[str, float], seed: int = 0) -> Falling:
    """The problem, with the mattes that its cameras would have seen."""
    problem = Falling(hidden, seed)
    true = problem.model([LinearDrag()], {**TRUTH, "drag": 0.0, **hidden})
    mattes = true.outlines(motion(true, true.start), true.start)[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    images = 1 - mattes[..., None] * torch.tensor([0.2, 0.5, 0.7])
    problem.video = replace(problem.video, silhouettes=mattes, images=images)
    return problem


def source_of(problem: Problem, folder: Path) -> Source:
    """As if it had been read from a run without a diagnosis."""
    return Source(problem, Store(folder / FOLDER, b"falling", {}), (str(folder),), None, Options())


def session_of(folder: Path, hidden: dict[str, float] | None = None, listed: str | None = None) -> Session:
    return Session.of(source_of(seen({"drag": DRAG} if hidden is None else hidden), folder), listed, jobs=1)


def study_of(folder: Path, names: Sequence[str] = ("low", "high")) -> Session:
    problems = [seen({"drag": DRAG}, seed) for seed in range(len(names))]
    return Session.of(source_of(StudyProblem(problems, names), folder), jobs=1)
