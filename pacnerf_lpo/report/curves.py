"""Losses and physical parameters over the iterations of a run, read from its TensorBoard events."""

from dataclasses import dataclass, field
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import SCALARS, EventAccumulator

from pacnerf_lpo.evaluation.run_directory import Stage

MAX_POINTS = 400
FOLDER = "tensorboard"


@dataclass
class Curve:
    """One logged scalar: for each phase that logged it, its label, the iterations within the phase, and the values."""

    name: str
    unit: str
    parts: list[tuple[str, list[int], list[float]]] = field(default_factory=list)


def read_curves(run_dir: Path, stages: list[Stage]) -> dict[str, Curve]:
    """Every scalar of the run by its name without phase, such as ``loss`` or ``E``.

    A scalar is logged as ``<phase>/<name> [<unit>]`` at steps that go on from phase to phase; slashes in units are
    written as bars.
    """
    events = EventAccumulator(str(run_dir / FOLDER), size_guidance={SCALARS: 0})
    if (run_dir / FOLDER).is_dir():
        events.Reload()
    curves: dict[str, Curve] = {}
    for tag in events.Tags().get(SCALARS, []):
        role, (name, unit) = tag.split("/")[0], split_unit(tag.split("/")[-1])
        points = [(event.step, event.value) for event in events.Scalars(tag)]
        curve = curves.setdefault(name, Curve(name, unit))
        first = 0
        for stage in stages:
            last = first + stage.record.steps
            if stage.record.phase == role:
                mine = _thinned([(step - first, value) for step, value in points if first <= step <= last])
                if mine:
                    curve.parts.append((stage.label, [p[0] for p in mine], [p[1] for p in mine]))
            first = last
    for curve in curves.values():
        curve.parts.sort(key=lambda part: [stage.label for stage in stages].index(part[0]))
    return curves


def split_unit(text: str) -> tuple[str, str]:
    """``E [Pa]`` to ``("E", "Pa")``; the unit is ``1`` where none is given."""
    name, _, unit = text.partition(" [")
    return name, unit.rstrip("]").replace("|", "/") or "1"


def _thinned(points: list[tuple[int, float]]) -> list[tuple[int, float]]:
    stride = -(-len(points) // MAX_POINTS) if points else 1
    return points[::stride] + ([points[-1]] if points and (len(points) - 1) % stride else [])
