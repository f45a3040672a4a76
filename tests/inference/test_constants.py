"""What is free to choose in a decision: a list that has to be changed by hand, and a reason for every entry."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "pacnerf_lpo"
DECIDING = {
    "inference/decision.py": {"LEVEL", "DECISIVE"},
    "inference/calibration.py": {"LENDING"},
    "inference/noise.py": {"WINDOW", "SHARING"},
    "diagnosis/catalogue.py": {"SPREADS"},
    "identification/model_errors.py": {"FORCE", "CONTACT", "FORCES", "SHAPES"},
    "diagnosis/screening.py": {"LEAST_CAMERAS"},
    "identification/rigid.py": {"CALIBRATED"},
}
"""Another value of one of these could make another verdict of the same recording."""
NUMERICAL = {
    "inference/calibration.py": {"DRAWS", "TAIL_DRAWS"},
    "inference/decision.py": {"LINEAR", "LEFT"},
    "inference/layout.py": {"AT_REST"},
    "inference/noise.py": {"LEAST_REPLICATES", "SHRINKAGES", "LARGEST_CORRELATION"},
    "inference/sensor.py": {"LEAST_ENTRIES", "FACTORS", "CLIPPED"},
    "diagnosis/comparison.py": {"WHITENED_ITERATIONS", "BENT"},
    "diagnosis/screening.py": {"LEAST_CHANGE", "PARALLEL", "EFFICIENCY"},
    "diagnosis/refitting.py": {"ITERATIONS", "QUICK", "GIVE_UP"},
    "identification/rigid.py": {"UNIT", "PLACE", "SPEED", "RELEASE", "ACROSS", "SHORT_DROP", "POWERS", "KEPT"},
}
"""Budgets of optimisers and simulations, grids of a search, and mathematical facts: a better value changes nothing but
the time it takes, and the last digits.
"""
PRESENTATION = {
    "diagnosis/catalogue.py": {"PACKAGE"},
    "diagnosis/comparison.py": {"CONFIDENCE"},
    "diagnosis/refitting.py": {"How"},
    "diagnosis/screening.py": {"FORCE", "SHAPE"},
}
"""How much of a distribution an interval shows, and names."""


def constants(path: Path) -> dict[str, str | None]:
    """Module-level constants, with the docstring right under the assignment."""
    body = ast.parse(path.read_text()).body
    found: dict[str, str | None] = {}
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(statement, ast.Assign | ast.AnnAssign):
            continue
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else None
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                found[name.id] = text
    return found


def listed(module: str) -> set[str]:
    return {name for table in (DECIDING, NUMERICAL, PRESENTATION) for name in table.get(module, ())}


@pytest.mark.parametrize("module", sorted({*DECIDING, *NUMERICAL, *PRESENTATION}))
def test_every_constant_of_a_decision_is_listed_here(module: str):
    assert set(constants(PACKAGE / module)) == listed(module)


def test_modules_of_the_inference_that_are_not_listed_have_no_constants_that_decide():
    """Two say when a parameter is called undetermined, and which terms of a force are named: in sentences only."""
    described = {"inference/intervals.py", "inference/force_law.py"}
    for path in sorted((PACKAGE / "inference").glob("*.py")):
        module = f"inference/{path.name}"
        if module not in described and not listed(module):
            assert not constants(path), module


@pytest.mark.parametrize(("module", "name"), [(m, n) for m, names in DECIDING.items() for n in sorted(names)])
def test_every_constant_that_decides_has_its_reason_under_it(module: str, name: str):
    reason = constants(PACKAGE / module)[name]
    assert reason is not None, f"{module}: {name} has no docstring"
    assert len(reason.split()) >= 10, f"{module}: {name}: {reason}"


def test_there_are_at_most_a_dozen():
    assert sum(map(len, DECIDING.values())) <= 12
