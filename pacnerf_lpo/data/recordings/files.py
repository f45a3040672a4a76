"""JSON, TOML, YAML of OpenCV and pickles of plain arrays to Python values, none of which can run code."""

import json
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pacnerf_lpo.data.recordings.media import library
from pacnerf_lpo.errors import UserInputError

HARMLESS = {
    *(("numpy", name) for name in ("ndarray", "dtype")),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
    *((f"numpy.{core}.numeric", "_frombuffer") for core in ("core", "_core")),
    ("_codecs", "encode"),
}
"""What a pickle of arrays, lists and numbers calls; none of it does anything but make them."""


class _OpenCVLoader(yaml.SafeLoader):
    """YAML with OpenCV's matrices."""


def _matrix(loader: yaml.SafeLoader, node: yaml.Node) -> np.ndarray:
    values = loader.construct_mapping(node, deep=True)  # type: ignore[arg-type]
    return np.array(values["data"], float).reshape(int(values["rows"]), int(values["cols"]))


_OpenCVLoader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


class _ArraysOnly(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in HARMLESS:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it calls {module}.{name}")


def read_values(path: Path) -> Any:
    """The content of a .json, .toml, .yml or .yaml file. Raises UserInputError where the file is missing or damaged."""
    try:
        text = path.read_text()
        if path.suffix == ".json":
            return json.loads(text)
        if path.suffix == ".toml":
            name = "tomllib" if sys.version_info >= (3, 11) else "tomli"
            return library(name, f"{path}: reading TOML").loads(text)
        return yaml.load(text.removeprefix("%YAML:1.0"), _OpenCVLoader)  # a SafeLoader
    except FileNotFoundError:
        raise UserInputError(f"{path}: missing; copy it there") from None
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserInputError(f"{path}: cannot be read ({reason}); write the file again") from None


def read_arrays(path: Path) -> Any:
    """A pickle of arrays, lists, dictionaries and numbers; anything else in it is refused before it runs. Raises
    UserInputError where the file is missing, damaged, or holds more than that.
    """
    try:
        with path.open("rb") as file:
            return _ArraysOnly(file).load()
    except FileNotFoundError:
        raise UserInputError(f"{path}: missing; copy it there") from None
    except pickle.UnpicklingError as error:
        raise UserInputError(
            f"{path}: refused, only arrays and numbers are read from a pickle ({error}); save the poses as arrays"
        ) from None
    except Exception as error:  # a damaged pickle raises whatever its bytes happen to mean
        raise UserInputError(f"{path}: a damaged pickle ({type(error).__name__}); write the file again") from None


def numbers(where: str, values: Any, *shapes: tuple[int, ...]) -> np.ndarray:
    """Finite numbers of the first of these shapes that they can be brought to; UserInputError where that fails."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        array = np.empty(0)
    for shape in shapes:
        if array.shape == shape or (len(shape) == 1 and array.size == shape[0]):
            if not np.isfinite(array).all():
                raise UserInputError(f"{where}: holds NaN or infinity; calibrate again")
            return array.reshape(shape)
    wanted = " or ".join(" x ".join(map(str, shape)) for shape in shapes)
    raise UserInputError(f"{where}: expected {wanted} numbers; write it again")


def number_at(where: str, values: Any, name: str, default: float | None = None) -> float:
    """The finite number under a key, or the default where there is no such key. Raises UserInputError for any other."""
    if default is not None and name not in values:
        return default
    value = entry(where, values, name)
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = float("nan")
    if not np.isfinite(found):
        raise UserInputError(f"{where}: '{name}' is {value!r}; give one finite number")
    return found


def entry(where: str, values: Any, *names: str) -> Any:
    """The value of the first of these keys that is there. Raises UserInputError where none is."""
    for name in names:
        if isinstance(values, dict) and name in values:
            return values[name]
    there = ", ".join(map(str, values)) if isinstance(values, dict) else "no keys"
    raise UserInputError(f"{where}: '{names[0]}' is missing (there are: {there}); add it")
