"""Scenes shipped with the package."""

from importlib.resources import files
from pathlib import Path

from pacnerf_lpo.errors import UserInputError

PREFIX = "asset:"


def demo_scene() -> Path:
    """Folder of the shipped scene: an elastic bird, 11 views of 128 x 128 pixels, 14 frames at 24 Hz."""
    return resolve_root(f"{PREFIX}bird")


def resolve_root(root: str) -> Path:
    """The folder that ``root`` names: a path, or ``asset:<name>`` for a shipped scene."""
    if not root.startswith(PREFIX):
        return Path(root).expanduser()
    assets = Path(str(files("pacnerf_lpo"))) / "assets"
    folder = assets / root.removeprefix(PREFIX)
    if not folder.is_dir():
        names = ", ".join(PREFIX + child.name for child in sorted(assets.iterdir()) if child.is_dir())
        raise UserInputError(f"data.root: there is no shipped scene {root}; there are: {names}")
    return folder
