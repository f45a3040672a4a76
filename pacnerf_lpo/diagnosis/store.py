"""Results of a diagnosis on disk: every step once, so that a stopped diagnosis goes on where it was.

Numbers are kept as JSON and arrays as NPZ without pickles: whoever reads a run that a stranger sent executes nothing.
"""

import dataclasses
import hashlib
import io
import json
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.residual_force import ResidualForce
from pacnerf_lpo.diagnosis.screening import Probes
from pacnerf_lpo.identification.model_errors import ModelErrors
from pacnerf_lpo.inference.checks import Prediction
from pacnerf_lpo.inference.force_law import Law, Term
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.intervals import Interval, Profile
from pacnerf_lpo.manifest import write_atomically

FOLDER = "diagnosis"
SCHEMA = 42
"""Number of the algorithm: to be raised with any change that makes other results of the same inputs."""
RECORDS = {
    kind.__name__: kind
    for kind in (
        Comparison,
        Hypothesis,
        Interval,
        Law,
        ModelErrors,
        Prediction,
        Probes,
        Profile,
        Refit,
        ResidualForce,
        Term,
    )
}
DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading a file raises that no step has written, or not to its end."""
Result = TypeVar("Result")


class Store:
    """What the steps found, under names that depend on all that they depend on.

    Args:
        folder: where they lie.
        problem: bytes that tell what is under diagnosis.
        options: of the diagnosis.
        candidates: the list of effects that compete; None: the whole catalogue.

    Attributes:
        key: how the names of files begin, whatever list they were found with.
        seconds: that every step took, by its name, whether that was now or in an earlier run.
    """

    def __init__(self, folder: Path, problem: bytes, options: dict, candidates: str | None = None):
        self.folder, self.seconds = folder, dict[str, float]()
        self.key = hashlib.sha256(problem + json.dumps([options, SCHEMA]).encode()).hexdigest()[:16]
        self._list = "" if candidates is None else f"{hashlib.sha256(candidates.encode()).hexdigest()[:8]}_"

    def once(self, name: str, step: Callable[[], Result], of_any_list: bool = False) -> Result:
        """What ``step`` gives; taken from disk where it was done before with the same inputs and options, and unless it
        is ``of_any_list`` with the same list of candidates. A damaged file is made again.
        """
        path = self.folder / "steps" / f"{self.key}_{'' if of_any_list else self._list}{name}.npz"
        if path.is_file():
            try:
                found = read(path)
                self.seconds[name] = float(found["seconds"])
                return found["result"]
            except DAMAGED:
                path.unlink()
        began = time.monotonic()
        result = step()
        self.seconds[name] = time.monotonic() - began
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, packed({"seconds": self.seconds[name], "result": result}))
        return result


def packed(result: Any) -> bytes:
    """Numbers, strings, arrays, lists, dictionaries and the records of a diagnosis as the bytes of an NPZ file."""
    arrays: dict[str, np.ndarray] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            arrays[f"a{len(arrays)}"] = value
            return {"array": f"a{len(arrays) - 1}"}
        if dataclasses.is_dataclass(value):
            fields = {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
            return {"record": type(value).__name__, "fields": fields}
        if isinstance(value, dict):
            return {"dict": {key: plain(entry) for key, entry in value.items()}}
        if isinstance(value, tuple):
            return {"tuple": [plain(entry) for entry in value]}
        if isinstance(value, list):
            return [plain(entry) for entry in value]
        return value.item() if isinstance(value, np.generic) else value

    text = json.dumps(plain(result))
    content = io.BytesIO()
    np.savez_compressed(content, structure=np.array(text), **arrays)  # type: ignore[arg-type]
    return content.getvalue()


def read(path: Path) -> Any:
    """What :func:`packed` has written; raises ValueError or KeyError for anything else."""
    with np.load(path, allow_pickle=False) as arrays:

        def whole(value: Any) -> Any:
            if isinstance(value, list):
                return [whole(entry) for entry in value]
            if not isinstance(value, dict):
                return value
            if "array" in value:
                return arrays[value["array"]]
            if "record" in value:
                return RECORDS[value["record"]](**{name: whole(entry) for name, entry in value["fields"].items()})
            if "tuple" in value:
                return tuple(whole(entry) for entry in value["tuple"])
            return {key: whole(entry) for key, entry in value["dict"].items()}

        return whole(json.loads(str(arrays["structure"])))
