"""Hashes of what the section ``data`` of a configuration reads."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pacnerf_lpo.data.assets import resolve_root
from pacnerf_lpo.data.index import read_index
from pacnerf_lpo.data.pac_nerf import choose_files
from pacnerf_lpo.errors import UserInputError


def data_digest(section: Mapping[str, Any]) -> str:
    """Hash of the contents of all files that a section ``data`` reads; UserInputError where it cannot be read."""
    root = resolve_root(section["root"])
    index = read_index(root)
    views = index.views()
    if section["train_views"] is not None and section["test_views"] is not None:
        views = sorted({*section["train_views"], *section["test_views"]})
    chosen = choose_files(root, index, views, section["frames"], section["background"])
    occluders = [path for view in views if (path := chosen.occluder(view)).exists()]
    digest = hashlib.sha256(file_digest(index.path))
    for path in (*chosen.needed(), *occluders):
        digest.update(path.name.encode())
        digest.update(file_digest(path))
    return digest.hexdigest()


@cache
def file_digest(path: Path) -> bytes:
    """SHA-256 of a file's contents; each file is read once per process."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except OSError as error:
        raise UserInputError(f"{path}: {error.strerror}") from None
