"""``diagnosis.html``: one page about what is missing in a model, to be read without statistics and without network."""

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report import diagnosis_sections as sections
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.flights import flights_section
from pacnerf_lpo.report.page import atlas, atlas_columns, page, parts
from pacnerf_lpo.report.wording import together

RESULT, PICTURES_FILE, PAGE_FILE = "diagnosis.json", "pictures.npz", "diagnosis.html"
FORMAT = 3
IMAGE_BUDGET = 5_000_000
QUALITIES = (75, 55, 35)
STYLES = ("report.css", "diagnosis.css")
SCRIPTS = ("base.js", "charts.js", "diagnosis_pictures.js", "diagnosis_flights.js", "diagnosis.js")


def write_page(folder: Path) -> Path:
    """Write ``diagnosis.html`` next to the ``diagnosis.json`` of a diagnosis, and its ``pictures.npz`` where there was
    a video; returns its path. UserInputError where an earlier version wrote them.
    """
    result = json.loads((folder / RESULT).read_text())
    if result["format"] != FORMAT:
        raise UserInputError(
            f"{folder / RESULT}: format {result['format']}, this version reads {FORMAT}: run pacnerf-lpo diagnose again"
        )
    images: dict[str, Any] = {"stages": []}
    if result["views"]:
        with np.load(folder / PICTURES_FILE) as pictures:
            images = build_images(dict(pictures))
    path = folder / PAGE_FILE
    write_atomically(path, render_page(result, images).encode())
    return path


def build_images(pictures: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Measured images, mattes and outlines of the model before and after as one picture per view, of a quality at which
    they fit the budget; of ``measured`` (V, F, h, w, 3), ``matte`` and ``models`` ([(S,) V, F, h, w]), uint8.
    """
    measured, matte, models = pictures["measured"], pictures["matte"], pictures["models"]
    frames, height, width = matte.shape[1:]
    for quality in QUALITIES:
        drawn = partial(atlas, size=(width, height), quality=quality)
        found = {
            "measured": [*map(drawn, measured)],
            "matte": [*map(drawn, matte)],
            "model": [[*map(drawn, model)] for model in models],
        }
        if len(json.dumps(found)) <= IMAGE_BUDGET:
            break
    stages = ["before", "after"][: len(models)]
    return {"width": width, "height": height, "columns": atlas_columns(frames), "stages": stages, **found}


def render_page(result: Mapping[str, Any], images: Mapping[str, Any]) -> str:
    """The page as text."""
    shown = ("unit", "views", "frames", "times", "held_views", "held_frames", "stages", "residual_force")
    rounds, labels = result["rounds"], [stage["readable"] for stage in result["stages"]]
    errors = [done["error"] for done in [*rounds, words.accepted(rounds[-1])] if done]  # beyond the model's own
    data = {
        **{name: result.get(name) for name in shown},
        "phases": rounds[0]["phases"],
        "images": images,
        "errors": [{"label": label, **error} for label, error in zip(labels, errors, strict=True)],
        "flights": result.get("flights") or [],
    }
    return page(
        "diagnosis",
        f"{result['scene']}: {result['verdict']['sentence']}",
        STYLES,
        SCRIPTS,
        data,
        result=result,
        unit=words.unit_of(result),
        light=words.light(result["verdict"]),
        cards=sections.first_screen(result),
        rounds=[_round(done, number) for number, done in enumerate(rounds)],
        flights=flights_section(result),
        points="" if result.get("flights") else sections.points_table(result),
        recordings=sections.recordings_section(result),
        parameters=sections.parameter_table(result),
        undetermined=words.undetermined(result),
        limits=words.NOT_IDENTIFIABLE,
        experiments=[f"To separate {names}: {experiment}." for names, experiment in words.experiments(result)],
        notes=words.notes(result),
        bounds=sections.bounds_table(result),
        effort=sections.effort_table(result),
    )


def _round(done: Mapping[str, Any], number: int) -> str:
    """Check, ranking, confounding and refits of one round; the first is open."""
    effects = together(done["effects"]) if done["effects"] else "no effect added"
    title = "The model as it was fitted" if not number else f"The model with {effects}"
    tables = sections.ranking(done), sections.confounding(done["screen"]), sections.refit_table(done)
    return parts("diagnosis").round(not number, title, words.checked(done), done, *tables)
