"""USD as a reader that shares no code with Pixar's library understands it, and as Pixar's validators judge it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdValidation

from pacnerf_lpo.export.motion import Subject
from pacnerf_lpo.export.points import write_usd


@pytest.fixture(scope="module", params=[".usd", ".usda"])
def written(request: pytest.FixtureRequest, subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / f"motion{request.param}"
    write_usd(subject, path)
    return path


@pytest.fixture
def text(written: Path) -> str:
    """The stage as tinyusdz reads and prints it."""
    tinyusdz = pytest.importorskip("tinyusdz", reason="has no release for Python 3.10")
    return tinyusdz.load(str(written)).export_to_string()


def samples(text: str, attribute: str) -> dict[float, np.ndarray]:
    """Time samples of an attribute."""
    (block,) = re.findall(rf"{attribute}\.timeSamples = \{{\n(.*?)\n\s*\}}", text, re.DOTALL)
    lines = (line.strip().rstrip(",").split(": ", 1) for line in block.splitlines())
    return {float(code): np.array(ast.literal_eval(values), dtype=np.float32) for code, values in lines}


def array(text: str, attribute: str) -> np.ndarray:
    """A value that does not change."""
    (found,) = re.findall(rf"{re.escape(attribute)} = (\[.*?\])(?: \(|\n)", text)
    return np.array(ast.literal_eval(found))


def test_beginnings_tell_the_binary_form_from_text(written: Path):
    assert written.read_bytes()[:8] == (b"PXR-USDC" if written.suffix == ".usd" else b"#usda 1.")


def test_units_axes_and_times(text: str):
    for line in (
        'upAxis = "Y"',
        "metersPerUnit = 1",
        "timeCodesPerSecond = 24",
        "startTimeCode = 0",
        "endTimeCode = 4",
    ):
        assert re.search(rf"^ *{line}$", text, re.MULTILINE), line
    assert "double E = 97000" in text


def test_points_move(subject: Subject, text: str):
    motion, points = subject.motion, samples(text, "points")
    assert list(points) == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(np.stack(list(points.values())), motion.positions)
    np.testing.assert_array_equal(np.stack(list(samples(text, "velocities").values())), motion.velocities)
    np.testing.assert_array_equal(array(text, "int64[] ids"), motion.numbers)
    np.testing.assert_allclose(array(text, "float[] widths"), [0.03], rtol=1e-6)
    for frame, (lower, upper) in samples(text, "extent").items():
        np.testing.assert_allclose(lower, motion.positions[int(frame)].min(0) - 0.015, atol=1e-6)
        np.testing.assert_allclose(upper, motion.positions[int(frame)].max(0) + 0.015, atol=1e-6)


def test_material_shows_the_colours_of_the_points(subject: Subject, text: str):
    linear = array(text, "primvars:displayColor")
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)  # the sRGB curve
    np.testing.assert_array_equal((shown * 255).round(), subject.motion.colours)
    assert 'interpolation = "vertex"' in text
    assert "rel material:binding = </Body/Material>" in text
    assert "token outputs:surface.connect = </Body/Material/Surface.outputs:surface>" in text
    assert "color3f inputs:diffuseColor.connect = </Body/Material/Colour.outputs:result>" in text
    assert 'string inputs:varname = "displayColor"' in text


def test_all_validators_are_content(written: Path):
    known = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(known).Validate(Usd.Stage.Open(str(written)))
    assert len(known) > 10 and not [(error.GetName(), error.GetMessage()) for error in errors]
