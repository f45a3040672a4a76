"""Every module can be imported first: no two import each other."""

import subprocess
import sys

import pytest

FIRST = [
    "pacnerf_lpo.identification.least_squares",
    "pacnerf_lpo.phases",
    "pacnerf_lpo.commands.diagnose",
    "pacnerf_lpo.evaluation.prediction",
]


@pytest.mark.parametrize("module", FIRST)
def test_a_module_can_be_imported_first(module):
    done = subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
