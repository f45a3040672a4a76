"""What stacked configuration files make together: which value of a scene file a later file changes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pacnerf_lpo.named_configs import configs_folder

SCENE_KEYS = ("data.root", "data.box_lower", "data.box_upper")
"""A file that sets one of them is about one scene; all that it sets was meant for that scene."""
FULL_SIZE = {"data.image_scale": 1.0}
"""What a scene file means that does not say otherwise: its images as they are."""
CLASS = ".class_path"


def read_yaml(path: Path) -> dict[str, Any]:
    """The sections of a configuration file that is known to be YAML."""
    return yaml.safe_load(path.read_text(encoding="utf-8")) or {}


def flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values by dotted key; lists are values."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            found.update(flat(value, f"{prefix}{key}."))
        else:
            found[f"{prefix}{key}"] = value
    return found


def shown(path: Path) -> str:
    """A configuration file as a person knows it: below the shipped folder, or as it was given."""
    folder = configs_folder()
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def scene_changes(files: Sequence[Path]) -> list[str]:
    """A sentence for each value of a scene file that a later one of these files, each valid YAML, changes."""
    earlier: dict[str, tuple[Any, str]] = {}
    found: list[str] = []
    for path in files:
        values = flat(read_yaml(path))
        for key in (key for key in values if key in earlier):
            value, source = earlier[key]
            if _differ(key, values[key], value):
                found.append(
                    f"{shown(path)} changes {key.removesuffix(CLASS)} from {value} ({source}) to {values[key]}"
                )
                if key.endswith(CLASS):  # its arguments go with the class
                    arguments = key.removesuffix(CLASS) + ".init_args."
                    earlier = {k: v for k, v in earlier.items() if not k.startswith(arguments)}
        if any(key in SCENE_KEYS for key in values):
            meant = {**{key: value for key, value in FULL_SIZE.items() if key not in earlier}, **values}
            earlier.update({key: (value, shown(path)) for key, value in meant.items() if not key.endswith("+")})
        else:
            earlier.update({key: (value, shown(path)) for key, value in values.items() if key in earlier})
    return found


def _differ(key: str, one: Any, other: Any) -> bool:
    if key.endswith(CLASS):
        return str(one).rpartition(".")[2] != str(other).rpartition(".")[2]
    try:
        return float(one) != float(other)  # YAML reads 3e5, without a point, as text
    except (TypeError, ValueError):
        return one != other
