"""The layers declared in pyproject.toml, which `make lint` checks, also hold inside functions."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_a_hidden_import_of_a_higher_layer_is_refused(tmp_path: Path):
    shutil.copytree(ROOT / "pacnerf_lpo", tmp_path / "pacnerf_lpo", ignore=shutil.ignore_patterns("assets", "*.pyc"))
    with (tmp_path / "pacnerf_lpo/mpm/physics.py").open("a") as file:
        file.write("\n\ndef hidden():\n    from pacnerf_lpo.render import camera_faults\n")
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--config", ROOT / "pyproject.toml"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert "pacnerf_lpo.mpm is not allowed to import pacnerf_lpo.render" in done.stdout


def test_what_reads_recordings_and_runs_starts_without_lightning():
    names = ("init", "check", "diagnose", "explore", "export", "plan", "render", "synthesize", "report", "evaluate")
    code = ";".join([*(f"import pacnerf_lpo.commands.{name}" for name in names), "import sys"])
    code += ";sys.exit('pytorch_lightning' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0
