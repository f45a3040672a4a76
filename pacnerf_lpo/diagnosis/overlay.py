"""The configuration that adds what a diagnosis has found to a run."""

from collections.abc import Sequence
from typing import Any

import yaml

from pacnerf_lpo.diagnosis.catalogue import as_config, class_path
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.mpm.effects.base import Effect


def overlay(problem: Problem, effects: Sequence[Effect], values: dict[str, float]) -> str:
    """A configuration file with the effects of a fitted model, and with its values [SI]. Of a run that identified
    nothing (``outer_loop.rounds: 0`` is enough for a diagnosis) it asks for one round.
    """
    material = {name: float(f"{values[name]:.6g}") for name in problem.physics.material.free_names}
    section: dict[str, Any] = {
        "physics": {
            "material": {"class_path": class_path(problem.physics.material), "init_args": material},
            "effects": [as_config(effect, values) for effect in effects],
        }
    }
    if isinstance(problem, RunProblem) and problem.run.config.get("outer_loop", {}).get("rounds") == 0:
        section["outer_loop"] = {"rounds": 1}
    head = "# Effects and values of a model; use it after the configuration of the run.\n"
    return head + yaml.safe_dump(section, sort_keys=False)
