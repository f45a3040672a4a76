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
