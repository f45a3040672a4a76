"""The configurations that the package ships, by name: ``fit``, ``scenes/torus``, ``effects/linear_drag``."""

from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path

from pacnerf_lpo.errors import UserInputError

PACKAGE = Path(__file__).resolve().parent
SUFFIX = ".yaml"
LIST_COMMAND = "pacnerf-lpo configs"


def configs_folder() -> Path:
    """The folder ``configs``: inside an installed package, next to it in the repository."""
    installed = PACKAGE / "configs"
    return installed if installed.is_dir() else PACKAGE.parent / "configs"


def config_names() -> list[str]:
    """The names of all shipped configurations: path below the folder, without suffix."""
    folder = configs_folder()
    paths = [path.relative_to(folder).with_suffix("") for path in folder.rglob(f"*{SUFFIX}")]
    return [path.as_posix() for path in sorted(paths, key=lambda path: (len(path.parts), path))]


def find_config(name: str, option: str) -> Path:
    """The file that an option means: one that exists, or else the shipped configuration of this name. Raises
    UserInputError where neither is there; the message names the option.
    """
    path = Path(name)
    if path.exists() and not path.is_dir():
        return path
    if name in config_names():
        return configs_folder() / f"{name}{SUFFIX}"
    what = "a folder" if path.is_dir() else "no such file"
    near = _nearest(name)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    raise UserInputError(
        f"{option} {name}: {what}, and no shipped configuration has that name; {hint}`{LIST_COMMAND}` lists them"
    )


def summary(name: str) -> str:
    """The first sentence of the comment at the top of a shipped configuration."""
    lines = (configs_folder() / f"{name}{SUFFIX}").read_text(encoding="utf-8").splitlines()
    comment = " ".join(line.lstrip("# ") for line in takewhile(lambda line: line.startswith("#"), lines))
    return comment.split(". ")[0].rstrip(".") + "."


def _nearest(name: str) -> list[str]:
    """Up to three shipped names like a wrong one, which may be only their last part or a path into the repository."""
    wanted = name.removesuffix(SUFFIX).rpartition("configs/")[2]
    spellings: dict[str, list[str]] = {}
    for known in config_names():
        for spelling in {known, known.rpartition("/")[2]}:
            spellings.setdefault(spelling, []).append(known)
    matches = get_close_matches(wanted, spellings, n=3)
    return list(dict.fromkeys(known for match in matches for known in spellings[match]))[:3]
