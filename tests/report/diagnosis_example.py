"""A small diagnosis as ``diagnose`` writes it: four cameras, six frames, linear drag missing; and its pictures."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.report.wording import readable

VIEWS, FRAMES, SIZE = [0, 2, 5, 7], list(range(6)), 24
HELD_VIEWS, HELD_FRAMES = [2], [5]


def stage(added: str | None, error: float) -> dict[str, Any]:
    return {
        "added": added,
        "readable": "as fitted" if added is None else "+ linear drag",
        "error": {"fitted": 0.8 * error, "held": error},
        "floor": {"fitted": 0.1, "held": 0.2},
        "by_frame": [round(error * (k + 1) / 6, 3) for k in FRAMES],
        "band": [[0.1] * 6, [0.3] * 6],
        "by_view": [error] * 4,
        "view_floor": [0.2] * 4,
        "excess": [
            [None if (v, f) == (3, 0) else error**2 * (v + 1) * f / 24 - 0.01 for f in FRAMES] for v in range(4)
        ],
    }


def candidate(name: str, factor: float, unit: str, label: str, camera: bool = False, **more: Any) -> dict[str, Any]:
    coefficient = "drag" if name == "LinearDrag" else name
    return {
        "name": name,
        "readable": readable(name),
        "camera": camera,
        "log_bayes_factor": factor,
        "p_value": 1e-6 if factor > 5 else 0.6,
        "coefficient": [0.5],
        "interval": [[-0.25, 0.75]],
        "strength": 3.0,
        "discrete": False,
        "one_sided": False,
        "signature": f"a trace <of> {name}",
        "separating_experiment": f"the experiment for {name}",
        "coefficients": [{"name": coefficient, "label": label, "unit": unit, "null": 0.0}],
        **more,
    }


def screen() -> dict[str, Any]:
    correlations = np.eye(5)
    correlations[0, 1] = correlations[1, 0] = 0.98
    return {
        "threshold": 5.0,
        "level": 0.01,
        "correlations": correlations.tolist(),
        "discrepancies": {
            "UnknownForce": {"log_bayes_factor": 25.0, "p_value": 1e-6},
            "WrongShape": {"log_bayes_factor": -2.0, "p_value": 1.0},
        },
        "candidates": [
            candidate("LinearDrag", 40.0, "1/s", "drag rate"),
            candidate("GravityMagnitude", 30.0, "m/s^2", "extra gravity"),
            candidate("InitialSpin", 4.0, "rad/s", "spin rate"),
            candidate("Exposure@5", 2.0, "1", "gain", camera=True),
            candidate("YieldStress", -1.0, "Pa", "yield stress", discrete=True),
        ],
    }


def parameter(name: str, value: float, unit: str, label: str) -> dict[str, Any]:
    ends = {"low": 0.8 * value, "high": 1.2 * value, "with_solver": [0.7 * value, 1.3 * value], "identifiable": True}
    return {"name": name, "value": value, "unit": unit, "label": label, "solver": 0.1 * value, **ends}


def refit(name: str, factor: float, held: float) -> dict[str, Any]:
    values = [parameter("E", 7e4, "Pa", "Young's modulus"), parameter("drag", 1.5, "1/s", "drag rate")]
    return {
        "name": name,
        "readable": readable(name),
        "camera": False,
        "signature": "the body arrives late",
        "separating_experiment": f"the experiment for {name}",
        "values": {one["name"]: {key: one[key] for key in one if "solver" not in key} for one in values},
        "cost_without": 900.0,
        "cost": 300.0,
        "log_bayes_factor": factor,
        "log_odds": factor - 44.0,
        "p_value": 1e-7,
        "notes": [],
        "excess": [[0.0] * 6] * 4,
        "error": {"fitted": held, "held": held},
    }


def check(statistic: float, p_value: float) -> dict[str, Any]:
    return {"statistic": statistic, "replicates": [1.0, 1.1, 0.9], "p_value": p_value}


def a_round(parameters: list[dict[str, Any]], refits: list[dict[str, Any]], accepted: str | None) -> dict[str, Any]:
    return {
        "effects": [],
        "parameters": parameters,
        "notes": [],
        "left_out": [],
        "disagreement": 1.0,
        "undetermined": ["raising nu while lowering E changes nothing that this recording shows"],
        "profiles": {},
        "check": check(9.0, 1e-7),
        "check_held": check(5.0, 1e-5),
        "phases": ["free fall"] * 3 + ["impact"] + ["contact"] * 2,
        "excess": [],
        "floor": [],
        "error": {"fitted": 0.7, "held": 0.9},
        "screen": screen(),
        "refits": refits,
        "accepted": accepted,
        "indistinguishable": [] if accepted is None else [accepted],
        "removed": [],
        "effort": {
            "compare": {"seconds": 40.0, "simulations": 60},
            "screen": {"seconds": 20.0, "simulations": 15},
            "refit": {"seconds": 30.0, "simulations": 25.0},
        },
    }


def missing() -> dict[str, Any]:
    """Drag was found, and the model with it is still being compared."""
    before = [parameter("E", 3.4e4, "Pa", "Young's modulus"), parameter("nu", 0.3, "1", "Poisson's ratio")]
    refits = [refit("GravityMagnitude", 33.0, 0.9), refit("LinearDrag", 44.0, 0.35)]
    return {
        "format": 3,
        "scene": "drag_<torus>",
        "views": VIEWS,
        "frames": FRAMES,
        "times": [k / 24 for k in FRAMES],
        "held_views": HELD_VIEWS,
        "held_frames": HELD_FRAMES,
        "verdict": {
            "kind": "missing",
            "effects": ["LinearDrag"],
            "nearest": [],
            "more_than_noise": False,
            "doubt": False,
            "removed": 0.64,
            "p_value": 1e-7,
            "sentence": "Linear drag is missing (p < 0.0001); adding it removes 64% of the held-out error.",
            "details": ["Young's modulus moves from 34 kPa to 70 kPa [49 kPa, 91 kPa]."],
        },
        "unit": "px",
        "stages": [stage(None, 1.0), stage("LinearDrag", 0.4)],
        "rounds": [a_round(before, refits, "LinearDrag")],
        "residual_force": None,
    }


def other(kind: str) -> dict[str, Any]:
    """The same recording with another outcome."""
    result = copy.deepcopy(missing())
    only = result["rounds"][0]
    result["verdict"] = {
        "kind": kind,
        "effects": [],
        "nearest": [],
        "more_than_noise": False,
        "doubt": False,
        "removed": None,
        "p_value": None,
        "sentence": f"Verdict of kind {kind}.",
        "details": [],
    }
    if kind == "camera":
        result["verdict"]["effects"] = ["Exposure@5"]
        result["stages"][0]["by_view"][2], result["stages"][0]["view_floor"][2] = 3.0, 0.25
        result["stages"][1]["by_view"][2] = 0.5
        return result
    result["stages"] = result["stages"][:1]
    only["accepted"], only["indistinguishable"], only["refits"] = None, [], []
    if kind == "nothing":
        only["check"], only["check_held"] = check(1.0, 0.4), check(1.1, 0.4)
        for one in only["screen"]["candidates"]:
            one["log_bayes_factor"] /= 20
            one["p_value"] = 0.25
        result["stages"][0]["error"]["held"] = 0.2
    if kind == "unknown":
        result["residual_force"] = {"determined": True, "times": [0.0, 0.1, 0.2], "mean": [[0.1, -1.0, 0.0]] * 3}
    if kind == "unfinished":
        only["screen"], only["refits"] = None, []
    return result


def write(folder: Path, result: dict[str, Any]) -> Path:
    """Result and pictures of a disc that falls, faster in the model before than in the one after."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "diagnosis.json").write_text(json.dumps(result))
    down, across = np.mgrid[:SIZE, :SIZE]

    def disc(speed: float) -> np.ndarray:
        found = [255 * ((down - 5 - speed * k) ** 2 + (across - 12) ** 2 < 16) for k in FRAMES]
        return np.repeat(np.array(found, np.uint8)[None], len(VIEWS), axis=0)

    matte = disc(2.0)
    models = np.stack([disc(2.6), disc(2.1)][: len(result["stages"])])
    measured = 255 - np.repeat(matte[..., None] // 2, 3, axis=-1)
    np.savez_compressed(folder / "pictures.npz", measured=measured, matte=matte, models=models)
    return folder
