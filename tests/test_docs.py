"""What README.md and CONTRIBUTING.md show is run: commands are parsed, the snippet and the recipes executed."""

from __future__ import annotations

import ast
import doctest
import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stdout, suppress
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo.__main__ import COMMANDS, main
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.recordings import layouts
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.mpm.simulator import Simulator
from tests.data.recordings.layouts import write_json
from tests.data.recordings.studio import FPS, FRAMES, Z_UP, World, intrinsic, opencv_intrinsic, raw, save
from tests.data.trajectories.throws import write_drops, write_throws

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))
from site_pages import config_keys, gallery, packages  # noqa: E402

README, CONTRIBUTING, REAL, EXPLORE = (
    ROOT / n for n in ("README.md", "CONTRIBUTING.md", "docs/real_measurements.md", "docs/explore.md")
)
GUIDE = [README, *sorted(path for path in (ROOT / "docs").glob("*.md") if path != REAL)]
LARGEST_PICTURES = 200_000
"""Of the pictures of real measurements together [bytes]."""
LARGEST_PICTURE, LARGEST_FILM = 150_000, 2_000_000
"""Of a picture of a page, and of the film of README [bytes]: a slow line shows them in seconds."""


def blocks(path: Path, language: str) -> list[str]:
    """The fenced code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(), re.MULTILINE | re.DOTALL)


def guide_commands() -> list[list[str]]:
    """Of README.md and the documentation, each once."""
    lines = dict.fromkeys(line for path in GUIDE for block in blocks(path, "sh") for line in block.splitlines())
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("pacnerf-lpo ")]


@lru_cache
def generated() -> tuple[str, ...]:
    """Pages that are made when the site is built."""
    return (*gallery.pages(), *config_keys.pages(), *packages.pages())


@pytest.fixture(scope="module")
def recipes(tmp_path_factory: pytest.TempPathFactory):
    """The files of CONTRIBUTING.md, importable."""
    folder = tmp_path_factory.mktemp("recipes")
    named = re.findall(r"^`(\w+\.py)`:\n\n```python\n(.*?)^```$", CONTRIBUTING.read_text(), re.MULTILINE | re.DOTALL)
    assert [name for name, _ in named] == ["kelvin_voigt.py", "lorentz.py", "rig_json.py", "ramp.py"]
    for name, text in named:
        (folder / name).write_text(text)
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


@pytest.mark.slow
def test_a_file_in_the_working_folder_is_found_by_the_command(tmp_path: Path):
    """By the installed command, which starts in no folder of the user's."""
    (tmp_path / "my_material.py").write_text("from pacnerf_lpo.mpm.materials import NeoHookean as Mine\n")
    config = {"physics": {"material": {"class_path": "my_material.Mine", "init_args": {"E": 1e4, "nu": 0.3}}}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(config))
    words = [word for name in ("fit", "scenes/torus") for word in ("--config", str(ROOT / "configs" / f"{name}.yaml"))]
    words += ["--config", "mine.yaml", "--data.root", "nowhere", "--print_config"]
    command = [Path(sys.executable).with_name("pacnerf-lpo"), "fit", *words]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.slow
def test_the_engines_snippet(small_threads: None):
    (snippet,) = blocks(ROOT / "docs/engine.md", "python")
    test = doctest.DocTestParser().get_doctest(snippet, {}, "engine.md", "docs/engine.md", 0)
    assert len(test.examples) > 5
    assert doctest.DocTestRunner().run(test).failed == 0


def test_commands_exist():
    assert {words[0] for words in guide_commands()} == set(COMMANDS)
    makefile = (ROOT / "Makefile").read_text()
    targets = {name for path in GUIDE for name in re.findall(r"(?:^|`)make (\w+)", path.read_text(), re.MULTILINE)}
    assert targets >= {"demo", "test", "docs"}
    for target in targets:
        assert f"\n{target}:" in makefile


def test_options_exist():
    """Of the commands that write nothing before they have read their options."""
    checked = 0
    for words in guide_commands():
        if words[0] in ("fit", "synthesize"):  # whose configurations are parsed elsewhere
            continue
        known = helped(words[0])
        for option in re.findall(r"--[\w-]+", " ".join(words[1:])):
            assert option.replace("-", "_") in known, f"{words}: {option}"
            checked += 1
    assert checked > 20


@lru_cache
def helped(command: str) -> str:
    shown = io.StringIO()
    with redirect_stdout(shown), suppress(SystemExit):
        main([command, "--help"])
    return shown.getvalue().replace("-", "_")


@pytest.mark.parametrize("words", [words for words in guide_commands() if "--data.root" in words], ids=" ".join)
def test_fits_parse(words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "my_scene.yaml").write_text((ROOT / "configs/scenes/torus.yaml").read_text())
    (tmp_path / "rubber.yaml").write_text("physics: {material: {class_path: NeoHookean}}\n")
    monkeypatch.chdir(tmp_path)
    assert set(PhaseCLI(words[1:], VideoModule, Physics).phases) >= {"static", "velocity", "physics"}


@pytest.mark.parametrize("path", [*GUIDE, CONTRIBUTING, REAL], ids=lambda path: path.name)
def test_links_and_paths_exist(path: Path):
    text = path.read_text()
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    links = [link for link in links if not link.endswith(generated())]  # the site is built with them, and checks them
    shown = re.findall(r"`((?:configs|notebooks|validation|tests)/[\w/.]+)`", text)
    inside = re.findall(r"`((?:mpm|phases|data|render|diagnosis|identification|inference)/[\w/.]+)`", text)
    for name in [*links, *shown, *(f"pacnerf_lpo/{name}" for name in inside)]:
        assert (path.parent / name).exists() or (ROOT / name).exists(), name


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2])
def test_commands_on_real_measurements_run(number: int, tmp_path: Path):
    """With positions in the form of theirs."""
    write_drops(tmp_path / "basketball.csv", drag=0.02)
    throws = tmp_path / "table_tennis"
    write_throws(throws, 2, drag=0.15, magnus=4e-3)
    (throws / "spins.csv").rename(throws / "index.csv")
    for path in throws.glob("0*.csv"):
        rows = [map(float, line.split(",")) for line in path.read_text().splitlines()[1:]]
        metres = [";".join(map(str, [t, x / 1000, y / 1000, z / 1000])) for t, x, y, z in rows]
        path.write_text("\n".join(["time;x;y;z", *metres]) + "\n")
    folder = Path(sys.executable).parent
    command = f"set -e\nexport PATH={folder}:$PATH\n{blocks(REAL, 'sh')[number]}"
    ended = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert "missing" in ended.stdout or "Nothing" in ended.stdout
    assert list(tmp_path.glob("**/diagnosis.html"))


@pytest.mark.slow
def test_the_benchmark_of_real_measurements_has_its_command():
    (line,) = blocks(REAL, "sh")[0].splitlines()
    words = shlex.split(line)
    ended = subprocess.run([sys.executable, *words[1:3], "--help"], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0 and all(word in ended.stdout for word in words if word.startswith("--"))


def test_pictures_of_the_documentation_are_small():
    shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", REAL.read_text())
    assert len(shown) == 2
    assert 0 < sum((REAL.parent / name).stat().st_size for name in shown) < LARGEST_PICTURES


def test_pictures_of_pages_are_small():
    shown = [EXPLORE.parent / name for name in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", EXPLORE.read_text())]
    assert len(shown) == 6
    assert all(0 < path.stat().st_size <= LARGEST_PICTURE for path in shown)
    (film,) = re.findall(r"!\[[^\]]+\]\(([^)]+\.gif)\)", README.read_text())
    assert 0 < (ROOT / film).stat().st_size <= LARGEST_FILM


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path: Path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    for kind in known_classes():
        assert kind.signature[1:20] in (tmp_path / "gallery" / f"{kind.__name__}.html").read_text(), kind
    pages = list(tmp_path.glob("**/*.html"))
    assert len(pages) > 40
    for page in pages:
        loaded = re.findall(r"<(?:script|img|iframe)[^>]* src=\"?(http[^\s\">]+)", page.read_text())
        loaded += re.findall(r"<link[^>]*rel=\"?stylesheet\"?[^>]*href=\"?(http[^\s\">]+)", page.read_text())
        assert not loaded, page


def messages() -> list[str]:
    """Every text in the package; what is filled in is a line break."""

    def text(node: ast.AST) -> str:
        if isinstance(node, ast.JoinedStr):
            return "".join(map(text, node.values))
        return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else "\n"

    trees = [ast.parse(path.read_text()) for path in (ROOT / "pacnerf_lpo").glob("**/*.py")]
    return [text(node) for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant | ast.JoinedStr)]


@pytest.mark.slow
def test_every_message_of_the_troubleshooting_is_one_of_the_package():
    quoted = re.findall(r'\*\*"([^"]+)"\*\*', (ROOT / "docs/troubleshooting.md").read_text())
    assert len(quoted) > 10
    said = messages()
    for message in quoted:
        pattern = re.compile(".*".join(re.escape(part.strip()) for part in message.split("…")), re.DOTALL)
        assert any(pattern.search(text) for text in said), message


def test_readme_is_short():
    assert len(README.read_text().splitlines()) <= 150


def test_table_of_effects_is_complete():
    page = gallery.pages()["gallery/index.md"]
    for kind in known_classes():
        name, units = kind.__name__, [f" [{p.unit}]" if p.unit != "1" else "" for p in kind.parameters.values()]
        listed = ", ".join(f"`{own}`{unit}" for own, unit in zip(kind.parameters, units, strict=True))
        assert f"| [`{name}`]({name}.md) | {listed} | {kind.signature} |" in page, name


@pytest.mark.slow
def test_the_recipe_of_a_layout_reads_a_recording(recipes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The studio's scene, written in its form."""
    import rig_json

    world = World(turn=Z_UP, origin=(0.4, -0.3, 0.8))
    poses = [(pose * [1.0, -1.0, -1.0, 1.0]).tolist() for pose in world.poses()]
    cameras = [{"name": f"c{k}", "K": opencv_intrinsic().tolist(), "pose": pose} for k, pose in enumerate(poses)]
    write_json(tmp_path / "rig.json", {"fps": FPS, "cameras": cameras})
    for view in range(len(poses)):
        for frame in range(FRAMES):
            save(tmp_path / f"c{view}" / f"{frame:02d}.png", raw()[view, frame])
    monkeypatch.setattr(layouts, "LAYOUTS", (*layouts.LAYOUTS, rig_json.LAYOUT))
    recording = layouts.read_recording(tmp_path)
    assert recording.layout == "rig-json" and recording.up == (0.0, 0.0, 1.0)
    for camera, pose in zip(recording.cameras, world.poses(), strict=True):
        np.testing.assert_allclose(camera.pose, pose, atol=1e-6)
        np.testing.assert_allclose(camera.intrinsic, intrinsic(), rtol=1e-6)
        assert len(camera.frames) == FRAMES and camera.frames[2].time == pytest.approx(2 / FPS)


def test_recipes_parse(recipes: Path, tmp_path: Path):
    overlays = []
    for number, text in enumerate(blocks(CONTRIBUTING, "yaml")):
        overlays.append(tmp_path / f"overlay_{number}.yaml")
        overlays[-1].write_text(text)
        assert set(yaml.safe_load(text)) <= {"physics", "phases"}
    files = [ROOT / "configs" / name for name in ("fit.yaml", "demo.yaml")] + overlays
    cli = PhaseCLI([word for file in files for word in ("--config", str(file))], VideoModule, Physics)
    assert type(cli.physics.material).__name__ == "KelvinVoigt"
    assert [type(effect).__name__ for effect in cli.physics.effects] == ["Lorentz"]
    assert {"eta", "gyration"} <= set(cli.physics.free_names)
    static = cli.phases["static"]
    assert static.surface_schedule.factor(250, 0) == 0.5 and static.surface_schedule.factor(900, 0) == 1.0


@pytest.fixture(scope="module")
def landing(recipes: Path):
    """Mean height after a contact, of a block with both recipes, as a function of all their parameters."""
    from kelvin_voigt import KelvinVoigt
    from lorentz import Lorentz

    simulator = Simulator(KelvinVoigt(), dx=0.1, substeps=60, effects=[Lorentz()], dtype="f64")
    axis = 0.05 * torch.arange(3, dtype=torch.float64)
    positions = torch.cartesian_prod(axis, axis + 0.07, axis)
    velocity = torch.tensor([0.3, -2.0, 0.0], dtype=torch.float64).expand_as(positions)
    mass, ones = torch.full((27,), 0.125, dtype=torch.float64), torch.ones(27, dtype=torch.float64)

    def height(values: dict[str, torch.Tensor]) -> torch.Tensor:
        material = {name: values[name] for name in ("E", "nu", "eta")}
        turning = {"gyration": values["gyration"]}
        return simulator(positions, velocity, mass, ones, material, 4, turning)[-1, :, 1].mean()

    return height


@pytest.mark.slow
@pytest.mark.parametrize("name", ["E", "nu", "eta", "gyration"])
def test_recipe_gradients(landing, name: str, small_threads: None):
    start = {"E": 3e4, "nu": 0.3, "eta": 20.0, "gyration": 0.1}
    values = {key: torch.tensor(value, dtype=torch.float64, requires_grad=True) for key, value in start.items()}
    landing(values).backward()
    step = 1e-4 * start[name]
    with torch.no_grad():
        above, below = (landing({**values, name: values[name] + sign * step}) for sign in (1, -1))
    expected = (above - below) / (2 * step)
    # truncation of the central difference: step^2 relative to the scale of variation, 1e-8; rounding 1e-16 / 1e-4
    torch.testing.assert_close(values[name].grad, expected, rtol=1e-5, atol=0.0)
    assert abs(float(expected)) * start[name] > 1e-6  # metres: the parameter matters
