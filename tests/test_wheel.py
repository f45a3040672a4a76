"""What is built from the repository works without it: from source distribution to report, in a folder anywhere.

By this Python alone, with the packages that it has. ``PACNERF_LPO_PYTHONS`` names others, separated by colons, or
``all`` that can be found from 3.10 to 3.13; each gets an environment of its own with what ``constraints.txt`` pins,
which wants a package index and some minutes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("pacnerf_lpo", "configs", "pyproject.toml", "setup.py", "README.md", "LICENSE")
BUILD = "import sys; from setuptools.build_meta import build_sdist; print(build_sdist(sys.argv[1]))"
FROM_SOURCE = ("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check")


def output(*command: str | Path, cwd: Path) -> str:
    """What a command prints; the repository is not on its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run(
        command, cwd=cwd, env={**environment, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def built_wheel(folder: Path) -> Path:
    """A wheel made of a source distribution that is made of the repository."""
    source = folder / "source"
    source.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, source)
    sdist = output(sys.executable, "-c", BUILD, folder, cwd=source).splitlines()[-1]
    output(sys.executable, "-m", "pip", "wheel", *FROM_SOURCE, "--wheel-dir", folder, folder / sdist, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


def pythons() -> list[str]:
    """The interpreters to test with."""
    wanted = os.environ.get("PACNERF_LPO_PYTHONS", "")
    if wanted != "all":
        return [path for path in wanted.split(":") if path] or [sys.executable]
    found = []
    for minor in range(10, 14):
        built = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))
        on_path = shutil.which(f"python3.{minor}")
        found += [str(built[-1])] if built else [on_path] if on_path else []
    return found


def installed(wheel: Path, folder: Path, python: str) -> Path:
    """The Python of a new environment with the wheel, and with the third-party packages of this Python, or, of another
    interpreter, with those of an index.

    The folder of this one's is only added to the path: an editable installation in it has a finder, which does not run
    then.
    """
    if python != sys.executable:
        output(python, "-m", "venv", folder, cwd=wheel.parent)
        pip = folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--constraint", ROOT / "constraints.txt"
        output(*pip, wheel, cwd=wheel.parent)
        return folder / "bin" / "python"
    venv.create(folder, symlinks=True)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)}))
    output(sys.executable, "-m", "pip", "install", *FROM_SOURCE, "--target", packages, wheel, cwd=folder)
    (packages / "third_party.pth").write_text("\n".join(path for path in sys.path if path.endswith("-packages")))
    return folder / "bin" / "python"


@pytest.mark.end_to_end
@pytest.mark.parametrize("interpreter", pythons())
def test_a_wheel_fits_by_names_in_any_folder(tmp_path: Path, interpreter: str):
    python = installed(built_wheel(tmp_path), tmp_path / "environment", interpreter)
    work = tmp_path / "work"
    work.mkdir()
    place = Path(output(python, "-c", "import pacnerf_lpo; print(pacnerf_lpo.__file__)", cwd=work).strip())
    assert place.is_relative_to(tmp_path / "environment")
    shipped, here = place.parent / "configs", ROOT / "configs"
    files = {path.relative_to(here): path.read_text() for path in here.rglob("*.yaml")}
    assert {path.relative_to(shipped): path.read_text() for path in shipped.rglob("*.yaml")} == files

    shutil.copy2(ROOT / "tests" / "smoke.yaml", work)
    names = ("fit", "demo", "effects/linear_drag", "smoke.yaml")
    words = [word for name in names for word in ("--config", name)]
    output(python, "-m", "pacnerf_lpo", "fit", *words, "--outer_loop.run_dir=run", cwd=work)
    assert (work / "run" / "report.html").is_file() and (work / "run" / "results.json").is_file()
    (effect,) = yaml.safe_load((work / "run" / "config.yaml").read_text())["physics"]["effects"]
    assert effect["class_path"].endswith("LinearDrag")
