"""Taichi's private calls: a newer version says so here, before anything is wrong."""

import ast
import subprocess
import sys
from pathlib import Path

import taichi

import pacnerf_lpo.mpm
from pacnerf_lpo.mpm.runtime import start
from pacnerf_lpo.mpm.taichi_calls import TRIED_WITH, ti

MPM = Path(pacnerf_lpo.mpm.__file__).parent


def test_the_version_is_the_one_that_they_were_tried_with():
    """With another one: run tests/mpm and the engine's benchmark, then write the new version down."""
    assert taichi.__version__ == TRIED_WITH


def test_no_other_module_imports_taichi():
    importing = set()
    for path in MPM.parent.glob("**/*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if any(name.partition(".")[0] == "taichi" for name in names):
                importing.add(path.relative_to(MPM).as_posix())
    assert importing == {"taichi_calls.py"}


@ti.data_oriented
class Counter:
    """A class with a kernel, which Taichi has to recognise as a method."""

    def __init__(self):
        self.count = ti.field(ti.i32, ())

    @ti.kernel
    def add(self, more: int):
        self.count[None] += more


AT_THE_TOP = """
from pacnerf_lpo.mpm.taichi_calls import ti
@ti.func
def twice(x):
    return 2 * x
@ti.kernel
def four() -> ti.i32:
    return twice(2)
ti.init(ti.cpu)
print(four())
"""


def test_kernels_of_classes_are_still_methods():
    start()
    counter = Counter()
    counter.add(3)
    counter.add(4)
    assert counter.count[None] == 7


def test_kernels_at_the_top_of_a_program_are_still_functions(tmp_path: Path):
    program = tmp_path / "program.py"
    program.write_text(AT_THE_TOP)
    shown = subprocess.run([sys.executable, program], capture_output=True, text=True)
    assert shown.stdout.split()[-1:] == ["4"], shown.stderr
