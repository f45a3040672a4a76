"""What a reader is."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pacnerf_lpo.data.recordings.recording import Recording


@dataclass(frozen=True)
class Layout:
    """A layout that can be read.

    name: what ``--format`` calls it
    looks_for: the files by which it is recognised, in words
    fits: whether a folder holds these files
    read: the recording in such a folder; raises UserInputError where something in it is wrong
    """

    name: str
    looks_for: str
    fits: Callable[[Path], bool]
    read: Callable[[Path], Recording]


def has(*files: str, without: str | None = None) -> Callable[[Path], bool]:
    """Whether a folder has these files, and lacks another one."""
    return lambda folder: (
        all((folder / file).is_file() for file in files) and (without is None or not (folder / without).is_file())
    )
