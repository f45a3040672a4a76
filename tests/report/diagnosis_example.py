"""A small diagnosis as ``diagnose`` writes it: four cameras, six frames, linear drag missing; and its pictures."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np

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


def candidate(name: str, z: float, unit: str, label: str, camera: bool = False, **more: Any) -> dict[str, Any]:
    coefficient = "drag" if name == "Linear drag" else name
    return {
        "name": name,
        "readable": name.lower(),
        "camera": camera,
        "z": z,
        "p_value": 1e-6 if z > 5 else 0.6,
        "coefficient": [0.5],
        "interval": [[-0.25, 0.75]],
        "fraction": 0.2,
        "snr": 3.0,
        "discrete": False,
        "one_sided": False,
        "signature": f"a trace <of> {name}",
        "separating_experiment": f"the experiment for {name}",
        "coefficients": [{"name": coefficient, "label": label, "unit": unit, "null": 0.0}],
        **more,
    }


def screen() -> dict[str, Any]:
    names = ["Linear drag", "Gravity", "Spin", "Exposure of view 5", "Yield"]
    likeness = np.eye(5)
    likeness[0, 1] = likeness[1, 0] = 0.98
    return {
        "threshold": 5.0,
        "false_alarms": 0.01,
        "groups": [["Linear drag", "Gravity"]],
        "correlations": likeness.tolist(),
        "candidates": [
            candidate(names[0], 40.0, "1/s", "drag rate"),
            candidate(names[1], 30.0, "m/s^2", "extra gravity"),
            candidate(names[2], 4.0, "rad/s", "spin rate"),
            candidate(names[3], 2.0, "1", "gain", camera=True),
            candidate(names[4], 1.0, "Pa", "yield stress", discrete=True),
        ],
    }


def parameter(name: str, value: float, unit: str, label: str) -> dict[str, Any]:
    ends = {"low": 0.8 * value, "high": 1.2 * value, "identifiable": True}
    return {"name": name, "value": value, "unit": unit, "label": label, **ends}


def refit(name: str, accepted: bool, held: float) -> dict[str, Any]:
    values = [parameter("E", 7e4, "Pa", "Young's modulus"), parameter("drag", 1.5, "1/s", "drag rate")]
    return {
        "name": name,
        "readable": name.lower(),
        "camera": False,
        "signature": "the body arrives late",
        "values": {value["name"]: value for value in values},
        "refined": 1.4,
        "misfit_before": 900.0,
        "misfit": 300.0,
        "accepted": accepted,
        "removed": 0.64 if accepted else -0.1,
        "z": 9.0 if accepted else 1.0,
        "reasons": [[True, "most held-out views improve"], [accepted, "the interval excludes the null"]],
        "excess": [[0.0] * 6] * 4,
        "error": {"fitted": held, "held": held},
    }


def a_round(parameters: list[dict[str, Any]], refits: list[dict[str, Any]], accepted: str | None) -> dict[str, Any]:
    return {
        "effects": [],
        "parameters": parameters,
        "undetermined": ["raising nu while lowering E changes nothing that this recording shows"],
        "omnibus": {"statistic": 9.0, "twins": [1.0, 1.1], "p_value": 1e-7},
        "omnibus_held": {"statistic": 5.0, "twins": [1.0, 1.2], "p_value": 1e-5},
        "phases": ["free fall"] * 3 + ["impact"] + ["contact"] * 2,
        "excess": [],
        "floor": [],
        "error": {"fitted": 0.7, "held": 0.9},
        "screen": screen(),
        "refits": refits,
        "accepted": accepted,
    }


def missing() -> dict[str, Any]:
    """Drag was found, and the model with it is still being compared."""
    before = [parameter("E", 3.4e4, "Pa", "Young's modulus"), parameter("nu", 0.3, "1", "Poisson's ratio")]
    refits = [refit("Gravity", False, 0.9), refit("Linear drag", True, 0.35)]
    return {
        "format": 1,
        "scene": "drag_<torus>",
        "views": VIEWS,
        "frames": FRAMES,
        "times": [k / 24 for k in FRAMES],
        "held_views": HELD_VIEWS,
        "held_frames": HELD_FRAMES,
        "verdict": {
            "kind": "missing",
            "effects": ["Linear drag"],
            "rest": False,
            "sentence": "Linear drag is missing (p < 0.0001); adding it removes 64% of the held-out error.",
            "details": ["Young's modulus moves from 34 kPa to 70 kPa."],
        },
        "unit": "px",
        "stages": [stage(None, 1.0), stage("Linear drag", 0.4)],
        "rounds": [a_round(before, refits, "Linear drag")],
        "residual_force": None,
    }


def other(kind: str) -> dict[str, Any]:
    """The same recording with another outcome."""
    result = copy.deepcopy(missing())
    only = result["rounds"][0]
    result["verdict"] = {
        "kind": kind,
        "effects": [],
        "rest": False,
        "sentence": f"Verdict of kind {kind}.",
        "details": [],
    }
    if kind == "camera":
        result["verdict"]["effects"] = ["Exposure@5"]
        result["stages"][0]["by_view"][2], result["stages"][0]["view_floor"][2] = 3.0, 0.25
        result["stages"][1]["by_view"][2] = 0.5
        return result
    result["stages"] = result["stages"][:1]
    only["accepted"], only["refits"] = None, only["refits"][:1]
    if kind == "nothing":
        only["omnibus"]["p_value"] = only["omnibus_held"]["p_value"] = 0.4
        result["stages"][0]["error"]["held"] = 0.2
    if kind == "unknown":
        result["residual_force"] = {"times": [0.0, 0.1, 0.2], "mean": [[0.1, -1.0, 0.0]] * 3}
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
