"""``fit SCENE``: which configurations are stacked for a scene folder, by a preset and by what the scene is like."""

import json
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from pacnerf_lpo.config_layers import flat, read_yaml, shown
from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.index import NAME as INDEX
from pacnerf_lpo.data.recordings.scene_file import steps_for, voxel_for
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.named_configs import configs_folder, find_config
from pacnerf_lpo.scene_folder import RUN, find_scene_file

METHOD = "phases.physics.init_args.method"
LEAST_GPU_MEMORY = 8 * 2**30
"""What the papers' resolution takes at most [bytes]: eleven views of 400 pixels, fourteen frames, and the gradients of
a rollout of a hundred thousand particles."""


@dataclass(frozen=True)
class Preset:
    """Resolution and method: names of shipped configurations, in their order, and to how many pixels the longer side of
    an image is reduced where it has more; None: never.
    """

    overlays: tuple[str, ...] = ()
    pixels: int | None = None


PRESETS = {
    "quick": Preset(("cpu", "cpu_outlines", "presets/quick"), 128),
    "cpu": Preset(("cpu",), 200),
    "paper": Preset(),
}
"""``cpu`` sees half of the papers' 400 pixels, which is what its configuration is made for."""


def stack(folder: Path, words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The command line of ``fit --config ...`` that ``pacnerf-lpo fit SCENE`` stands for, from ``fit``, the preset, the
    scene file and the words that were typed; and sentences, one line each, on how it came about. Raises UserInputError
    where there is no scene folder, or no such preset.

    Values of the scene file win over those of a preset. Only the identification method is the preset's wherever the
    scene names another one. Voxels, time steps and images that the scene does not set follow its size, and never a
    constant of a preset.
    """
    file = find_scene_file(folder)
    given, rest = take_option(words, "--preset")
    out, rest = take_option(rest, "--out")
    own_dir, rest = take_option(rest, "--outer_loop.run_dir")
    run_dir = Path(own_dir or out or folder / RUN)
    name, remarks = _choose(given or "auto", run_dir)
    preset = PRESETS[name]
    values = flat(read_yaml(file))
    overlays = [find_config(overlay, "--preset") for overlay in preset.overlays]
    begin = [word for path in (find_config("fit", "--preset"), *overlays) for word in ("--config", str(path))]
    end = ["--config", str(file), *_moved(folder, values)]
    method, remark = _method([configs_folder() / "fit.yaml", *overlays], file, values)
    if method:
        end += [f"--{METHOD}={json.dumps(method)}"]
        remarks += [f"preset {name} changes {remark}"]
    if name == "paper" and torch.cuda.is_available():
        begin += ["--trainer.accelerator=gpu"]
    end += ["--preset", name, "--outer_loop.run_dir", str(run_dir), *rest]
    return [*begin, *_by_size(folder, values, preset), *end], remarks


def _choose(given: str, run_dir: Path) -> tuple[str, list[str]]:
    """A preset's name; ``auto`` is that of the run which is there, else what the machine can do."""
    if given in PRESETS:
        return given, []
    if given != "auto":
        raise UserInputError(f"--preset {given}: give auto, {', '.join(PRESETS)}")
    config = run_dir / "config.yaml"
    before = read_yaml(config).get("preset") if config.is_file() else None
    if before in PRESETS:
        return before, []
    memory = torch.cuda.get_device_properties(0).total_memory if torch.cuda.is_available() else 0
    if memory >= LEAST_GPU_MEMORY:
        return "paper", ["preset paper: there is a GPU with memory enough"]
    return "cpu", ["preset cpu: there is no GPU with memory enough; --preset quick is faster and coarser"]


def _by_size(folder: Path, values: Mapping[str, Any], preset: Preset) -> list[str]:
    """Options for what follows the size of body and images; the scene file, which comes later, may set them itself."""
    found = []
    box = [values.get(f"data.box_{end}") for end in ("lower", "upper")]
    if all(isinstance(corner, list) and len(corner) == 3 for corner in box):
        spacing = voxel_for(max(high - low for low, high in zip(*box, strict=True)))
        spacing = float(values.get("phases.static.init_args.base_spacing", spacing))
        steps = steps_for(spacing, float(values.get("physics.frame_rate", 24.0)))
        found += [f"--phases.static.init_args.base_spacing={spacing:g}", f"--physics.substep_rate={steps:.1f}"]
    images = next(iter(sorted((folder / "data").glob("[mr]_*_*.png"))), None)
    if preset.pixels is not None and images is not None:
        found += [f"--data.image_scale={min(1.0, preset.pixels / max(image_size(images))):.4g}"]
    return found


def _moved(folder: Path, values: Mapping[str, Any]) -> list[str]:
    """Where the images are, if the scene file does not say it, or if the folder was moved since it was written."""
    root = values.get("data.root")
    there = isinstance(root, str) and (root.startswith("asset:") or Path(root).is_dir())
    return ["--data.root", str(folder)] if not there and (folder / INDEX).is_file() else []


def _method(files: Sequence[Path], file: Path, values: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """The preset's identification method where the scene file names another class, and the change in words."""
    chosen: dict[str, Any] = {}
    for path in files:
        section: Any = read_yaml(path)
        for key in METHOD.split("."):
            section = section.get(key) or {} if isinstance(section, dict) else {}
        same = section.get("class_path", chosen.get("class_path")) == chosen.get("class_path")
        arguments = {**(chosen.get("init_args", {}) if same else {}), **section.get("init_args", {})}
        chosen = {**chosen, **section, "init_args": arguments}
    own = str(values.get(f"{METHOD}.class_path", chosen["class_path"])).rpartition(".")[2]
    if own == chosen["class_path"]:
        return {}, ""
    return chosen, f"{METHOD} from {own} ({shown(file)}) to {chosen['class_path']}"


def take_option(words: Sequence[str], option: str) -> tuple[str | None, list[str]]:
    """The last value of an option, and the command line without it."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(option, dest="value", nargs="?")
    found, rest = parser.parse_known_args(words)
    return found.value, rest
