"""Draw blind scenes: ``python -m validation.hidden_effects.generate FOLDER --first 1000 --count 200``."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import joblib
import numpy as np
import torch

from pacnerf_lpo.diagnosis.catalogue import known_classes, name_of
from pacnerf_lpo.errors import RunError, SimulationError, UserInputError
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.render.camera_faults import Observation
from validation.hidden_effects import full, outside
from validation.hidden_effects.film import film
from validation.hidden_effects.known_shape import SETTING, TRUTH, VIDEO
from validation.hidden_effects.plan import Family, Plan, plan
from validation.hidden_effects.setting import FAST, FULL, Setting, Size, draw_setting
from validation.hidden_effects.strength import Ruler, Sized, course_of

ATTEMPTS = 8
REPLICATES = 8
MATERIAL_FOR = {"ShearThinning": "Newtonian", "Cohesion": "DruckerPrager", "YieldStress": "NeoHookean"}


def generate(folder: Path, seed: int, size: Size = FAST) -> Path:
    """Write the scene of a seed, unless it is there; with the same package the same seed gives the same scene.

    Raises:
        RunError: no stable scene with the wanted strength was found.
    """
    wanted, target = plan(seed), folder / f"{seed:04d}"
    if size.trained and wanted.family == "camera":
        raise UserInputError(f"scene {seed}: videos of wrong cameras are not drawn")
    if (target / TRUTH).is_file():
        return target
    for attempt in range(ATTEMPTS):
        random = np.random.default_rng((seed, attempt))
        try:
            drawn = _draw(wanted, size, random)
        except SimulationError:
            continue
        if drawn is not None:
            break
    else:
        raise RunError(f"scene {seed}: {' + '.join(wanted.effects)} reaches {wanted.snr:g} in none of {ATTEMPTS} draws")
    setting, true, hidden, strengths = drawn
    values = {**true, **{name: value for effect in hidden for name, value in effect.guess.items()}}
    recorded = film(setting, values, hidden, random, size.finer)
    partial = target.with_name(f".{target.name}.part")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    if size.trained:
        full.write(partial, setting, size.trained, recorded, random)
    else:
        silhouettes = (recorded.silhouettes * 255).round().to(torch.uint8).numpy()
        np.savez_compressed(partial / VIDEO, silhouettes=silhouettes, brightness=recorded.brightness)
    (partial / SETTING).write_text(json.dumps(setting.as_json()))
    truth = {
        **asdict(wanted),
        "attempt": attempt,
        "values": true,
        "hidden": [
            {"name": name_of(effect), "null": effect.null, **asdict(strength)}
            for effect, strength in zip(hidden, strengths, strict=True)
        ],
    }
    (partial / TRUTH).write_text(json.dumps(truth, indent=1))
    partial.rename(target)
    return target


Drawn = tuple[Setting, dict[str, float], list[Effect], list[Sized]]


def _draw(wanted: Plan, size: Size, random: np.random.Generator) -> Drawn | None:
    """A setting, its true values, and the hidden effects with their strengths; None where one is out of reach."""
    materials = {MATERIAL_FOR[name] for name in wanted.effects if name in MATERIAL_FOR}
    if len(materials) > 1:
        raise UserInputError(f"scene {wanted.seed}: no material has {' and '.join(wanted.effects)}")
    setting, true = draw_setting(random, size, next(iter(materials), None))
    hidden: list[Effect] = []
    strengths: list[Sized] = []
    seen = full.as_diagnosed(setting) if size.trained else setting
    ruler = Ruler(seen, true, REPLICATES) if wanted.effects else None
    for name in wanted.effects:
        assert ruler is not None
        effect = _at_null(name, size, random)
        try:
            effect.check_material(setting.law)
            sized = ruler.sized_beyond if isinstance(effect, outside.OutsideEffect) else ruler.sized
            found = sized(effect, course_of(effect, random), wanted.snr)
            hidden += [] if found is None else [_at(effect, found.values)]
        except UserInputError:  # not for this material, or a value beyond its bounds
            return None
        if found is None:
            return None
        strengths.append(found)
    return setting, true, hidden, strengths


def _at_null(name: str, size: Size, random: np.random.Generator) -> Effect:
    kind = getattr(outside, name, None) or next(kind for kind in known_classes() if kind.__name__ == name)
    return kind(view=int(random.integers(size.views))) if issubclass(kind, Observation) else kind()


def _at(effect: Effect, values: dict[str, float]) -> Effect:
    """The effect with other values of its coefficients, by their full names."""
    if isinstance(effect, outside.OutsideEffect):
        return type(effect)(next(iter(values.values())))
    own = {short: values[full] for short, full in zip(type(effect).parameters, effect.parameters, strict=True)}
    if isinstance(effect, Observation):
        own["view"] = effect.view  # type: ignore[assignment]
    return type(effect)(**own)


def generate_all(folder: Path, seeds: Sequence[int], jobs: int, size: Size = FAST) -> Iterator[str]:
    """A line for every scene."""
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(
        joblib.delayed(_line)(folder, seed, size) for seed in seeds
    )


def _line(folder: Path, seed: int, size: Size) -> str:
    torch.set_num_threads(1)
    try:
        return f"{generate(folder, seed, size)}"
    except (RunError, SimulationError, UserInputError) as error:
        return f"{seed}: not drawn ({error})"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=1000, help="seed; below 1000: development, from 1000: scored")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--family", choices=get_args(Family), help="only scenes of this family; without it, all")
    parser.add_argument("--full", choices=FULL, help="videos to reconstruct from so many views; no camera faults")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    wanted = range(options.first, options.first + options.count)
    seeds = [seed for seed in wanted if options.family in (None, plan(seed).family)]
    for line in generate_all(options.folder, seeds, options.jobs, FULL.get(options.full, FAST)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
