"""What the pages show is run where that takes seconds: commands on recordings and measurements, and code."""

from __future__ import annotations

import ast
import doctest
import json
import re
import shlex
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.explore import Session
from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.presets import stack
from tests.data.recordings.layouts import opencv_shared
from tests.data.trajectories.throws import write_throws
from tests.test_docs import CONTRIBUTING, GUIDE, ROOT, blocks, gallery, guide_commands

TINY = ["--views", "6", "--image_size", "64", "--dx", "0.06", "--frames", "10"]
"""Of a synthetic video that is read and not fitted."""
PAGES = [*GUIDE, CONTRIBUTING, *sorted((ROOT / "validation/results").glob("*.md"))]


def commands(page: str, name: str) -> list[list[str]]:
    """The commands of a page that begin with a word, as they stand there."""
    lines = [line for block in blocks(ROOT / page, "sh") for line in block.splitlines()]
    words = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith(f"pacnerf-lpo {name} ")]
    assert words, page
    return words


@pytest.mark.slow
def test_a_recording_becomes_a_scene_as_readme_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """README and the page about recordings: ``init``, and the look at the scene."""
    monkeypatch.chdir(tmp_path)
    source = tmp_path / "recordings" / "drop"
    source.mkdir(parents=True)
    opencv_shared(source)
    (made,) = commands("README.md", "init")
    assert commands("docs/own_recording.md", "init") == [made]
    assert main(made) == 0
    (tmp_path / "scenes/drop/scene.html").unlink()
    assert main(["report", "scenes/drop"]) == 0
    assert (tmp_path / "scenes/drop/scene.html").stat().st_size > 10_000


@pytest.mark.slow
def test_measured_flights_are_diagnosed_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write_throws(tmp_path / "throws", 2, drag=0.15, magnus=4e-3)
    (tmp_path / "throws/spins.csv").rename(tmp_path / "spins.csv")
    (made,), (diagnosed,) = (commands("docs/measurements.md", name) for name in ("init", "diagnose"))
    assert main(made) == 0 and main(diagnosed) == 0
    assert list(tmp_path.glob("**/diagnosis.html"))


@pytest.mark.slow
def test_an_effect_of_ones_own_is_found_as_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The page from beginning to end: the class, throws that a script makes, and the diagnosis that names it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    page = ROOT / "docs/own_effect.md"
    effect, script = blocks(page, "python")
    candidates, overlay = blocks(page, "yaml")
    (synthesized,) = commands("docs/own_effect.md", "synthesize")
    assert len(effect.splitlines()) <= 40
    (tmp_path / "magnetic.py").write_text(effect)
    (tmp_path / "candidates.yaml").write_text(candidates)
    (tmp_path / "own.yaml").write_text(overlay)
    exec(compile(script, "own_effect.md", "exec"), {})
    for name in ("init", "diagnose"):
        words, of_video = commands("docs/own_effect.md", name)
        assert main(words) == 0
    assert main([*synthesized, *TINY]) == 0 and main(commands("docs/own_effect.md", "init")[1]) == 0
    assert json.loads(Path("synthetic/charged/truth.json").read_text())["hidden_effects"]["magnetic"] == {
        "gyration": 0.8
    }
    assert of_video[1] == "scenes/charged" and Path("scenes/charged/scene.yaml").is_file()
    found = json.loads((tmp_path / "scenes/throws/diagnosis/diagnosis.json").read_text())
    assert found["verdict"]["effects"] == ["Magnetic"]
    written = set(found) - {"verdict", "rounds"} | {f"verdict.{key}" for key in found["verdict"]}
    written |= {f"rounds[].{key}" for one in found["rounds"] for key in one}
    written |= {f"rounds[].refits[].{key}" for one in found["rounds"] for refit in one["refits"] for key in refit}
    assert written == keys_of_formats("### diagnosis.json")
    (fitted,) = (one for one in found["rounds"][-1]["parameters"] if one["name"] == "gyration")
    assert fitted["low"] < 0.8 < fitted["high"]  # the script's k; 90 % intervals, with its one seed
    words = [word for file in ("fit", "demo", "own.yaml") for word in ("--config", file)]
    assert [type(one).__name__ for one in PhaseCLI(words, VideoModule, Physics).physics.effects] == ["Magnetic"]


@pytest.mark.slow
def test_a_material_of_ones_own_works_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    page = ROOT / "docs/own_material.md"
    law, tried = blocks(page, "python")
    overlay, several = blocks(page, "yaml")
    (tmp_path / "stiffening.py").write_text(law)
    (tmp_path / "rubber.yaml").write_text(overlay)
    test = doctest.DocTestParser().get_doctest(tried, {}, page.name, str(page), 0)
    assert doctest.DocTestRunner().run(test).failed == 0
    (synthesized,), (made,) = (commands("docs/own_material.md", name) for name in ("synthesize", "init"))
    assert main([*synthesized, *TINY]) == 0 and main(made) == 0
    ((_, scene, *words),) = commands("docs/own_material.md", "fit")
    physics = PhaseCLI(stack(Path(scene), words)[0], VideoModule, Physics).physics
    assert type(physics.material).__name__ == "Stiffening" and {"E", "nu", "s"} <= set(physics.free_names)
    (tmp_path / "rubber.yaml").write_text(several)
    material = PhaseCLI(stack(Path(scene), words)[0], VideoModule, Physics).physics.material
    assert [type(law).__name__ for law in material.guesses(1.0, 1.0)] == ["NeoHookean", "Stiffening"]
    assert material.guesses(1.0, 1.0)[1].guess == {"E": 1e5, "nu": 0.3, "s": 1.0}, "an impact changes nothing"


def keys_of_formats(heading: str) -> set[str]:
    """Of the page about formats, from a heading on; the second of a row is next to the first."""
    text = (ROOT / "docs/formats.md").read_text()
    rows = re.findall(r"^\| `([\w.\[\]]+)`(?:, `(\w+)`)? \|", text[text.index(heading) :], re.MULTILINE)
    besides = {f"{first.rpartition('.')[0]}.{second}".removeprefix(".") for first, second in rows if second}
    return {first for first, _ in rows} | besides


def test_keys_of_formats_are_written_by_the_package():
    names = {key.rpartition(".")[2].removesuffix("[]") for key in keys_of_formats("### results.json")}
    assert {"doubts", "verdict", "sentence", "indistinguishable"} - {"verdict"} <= names
    source = "".join(path.read_text() for path in (ROOT / "pacnerf_lpo").glob("**/*.py"))
    assert all(re.search(rf'"{name}"|\b{name}: ', source) for name in names)


@pytest.mark.parametrize("words", [words for words in guide_commands() if words[0] == "configs"], ids=" ".join)
def test_configurations_are_listed(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main([word for word in words if not word.startswith(">")][:2]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 5


def test_every_named_configuration_exists():
    made_by_hand = {"my_scene.yaml", "rubber.yaml"}
    named = set()
    for words in guide_commands():
        named |= {after for word, after in pairwise(words) if word in ("--config", "--overlay")}
    named = {name for name in named if not name.startswith("runs/") and "/run/" not in name} - made_by_hand
    assert {"fit", "cpu", "effects/ground_friction"} <= named
    for name in named:
        assert (ROOT / "configs" / f"{name.removesuffix('.yaml').removeprefix('configs/')}.yaml").is_file(), name


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_programs_and_their_options_exist(path: Path):
    """``python -m MODULE`` and ``python FILE``, in blocks and in sentences."""
    for line in re.findall(r"python ((?:-m validation\.|validation/|docs/)[^`\n#]*)", path.read_text()):
        first, *words = line.removeprefix("-m ").split()
        source = ROOT / first if first.endswith(".py") else ROOT / f"{first.replace('.', '/')}.py"
        if not source.is_file():
            source = source.with_suffix("") / "__init__.py"
        text = source.read_text()
        for option in (word for word in words if word.startswith("--")):
            assert f'"{option}"' in text, f"{path.name}: {line}"


def test_the_snippet_about_sessions_uses_what_there_is():
    (snippet,) = blocks(ROOT / "docs/explore.md", "python")
    tree = ast.parse(snippet)
    for node in (node for node in tree.body if isinstance(node, ast.ImportFrom)):
        exec(compile(ast.Module([node], []), "explore.md", "exec"), {})
    used = {
        node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "session"
    }
    assert used and all(hasattr(Session, name) for name in used)


@pytest.mark.parametrize("name", sorted(set(materials.__all__) - {"Auto", "Material"}))
def test_the_lines_of_a_material_are_a_configuration(name: str, tmp_path: Path):
    (text,) = re.findall(r"```yaml\n(.*?)```", gallery.pages()[f"gallery/{name}.md"], re.DOTALL)
    assert set(yaml.safe_load(text)) == {"physics"}
    (tmp_path / "law.yaml").write_text(text)
    words = [word for file in ("fit", "demo", str(tmp_path / "law.yaml")) for word in ("--config", file)]
    assert type(PhaseCLI(words, VideoModule, Physics).physics.material).__name__ == name
