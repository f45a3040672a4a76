"""Files and folders that appear whole or not at all, and that replace nothing but files of their own kind."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pacnerf_lpo.errors import UserInputError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name with the same ending next to ``path``, to write to; it becomes ``path`` if no error ends the block."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        temporary.touch()
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """An empty folder next to ``path``, to write into; it takes the place of ``path`` if no error ends the block."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary, old = (path.with_name(f".{path.name}.{word}") for word in ("part", "old"))
    for left in (temporary, old):
        shutil.rmtree(left, ignore_errors=True)
    try:
        temporary.mkdir()
        yield temporary
        if path.exists():
            path.rename(old)
        temporary.rename(path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    shutil.rmtree(old, ignore_errors=True)


def check_output(path: Path, own: str | None) -> None:
    """Raise UserInputError where a file cannot be written under this name, or a folder of files with ``own`` names
    would replace something else.
    """
    if own is None and path.is_dir():
        raise UserInputError(f"--output {path}: is a folder; give the name of a file")
    if own is not None and path.exists() and not path.is_dir():
        raise UserInputError(f"--output {path}: is a file, and one file per frame needs a folder; give another name")
    above = next(parent for parent in path.absolute().parents if parent.exists())
    if not above.is_dir():
        raise UserInputError(f"--output {path}: {above} is a file, not a folder; give another name")
    other = sorted(file.name for file in path.glob("*") if own is not None and not re.fullmatch(own, file.name))
    if other:
        raise UserInputError(f"--output {path}: the folder holds other files, such as {other[0]}; give another name")
