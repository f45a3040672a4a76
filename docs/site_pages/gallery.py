"""The pages of the gallery: one for every material, effect and camera fault, made from its class."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.render.camera_faults.base import Observation
from site_pages.scenes import COMPARISONS

ROOT = Path(__file__).resolve().parents[2]
BAR = "\\|"


def pages() -> dict[str, str]:
    """A page for every material, effect and camera fault, and one that lists them, by their paths."""
    laws = [getattr(materials, name) for name in materials.__all__ if name not in ("Auto", "Material")]
    faults = [kind for kind in known_classes() if issubclass(kind, Observation)]
    effects = [kind for kind in known_classes() if kind not in faults]
    pages = {f"gallery/{kind.__name__}.md": effect_page(kind) for kind in known_classes()}
    pages |= {f"gallery/{kind.__name__}.md": material_page(kind) for kind in laws}
    listed = [
        "# Materials, effects and camera faults",
        "Each is a class in a file of its own; these pages are made from the classes, and `python "
        "docs/site_pages/films.py` makes the films by the engine. In a film, the body on the left is without the "
        "effect, the one on the right with it, and stronger than in most recordings; the grey shadow is where the left "
        "one is.",
        "## Materials",
        _list(laws, [" ".join(_described(kind).split("\n\n")[0].split()) for kind in laws]),
        "## Effects",
        _list(effects, [kind.signature for kind in effects]),
        "## Camera faults",
        _list(faults, [kind.signature for kind in faults]),
        "How to add one of your own: [contributing](../contributing.md).",
    ]
    pages["gallery/index.md"] = "\n\n".join(listed) + "\n"
    return pages


def _list(kinds: list[type], said: list[str]) -> str:
    rows = [
        f"| [`{kind.__name__}`]({kind.__name__}.md) | {_listed(kind)} | {text.replace('|', BAR)} | {_film(kind, 190)} |"
        for kind, text in zip(kinds, said, strict=True)
    ]
    return "\n".join(["| name | parameters | what it is or shows | film |", "|---|---|---|---|", *rows])


def _listed(kind: Any) -> str:
    """Its parameters and their units."""
    units = [f" [{parameter.unit}]" if parameter.unit != "1" else "" for parameter in kind.parameters.values()]
    return ", ".join(f"`{name}`{unit}" for name, unit in zip(kind.parameters, units, strict=True))


def _film(kind: type, width: int) -> str:
    """The film of a class as an image; its words for who does not see it."""
    words = f"Without and with {kind.__name__}: {COMPARISONS[kind.__name__].words}"
    return f'![{words}]({kind.__name__}.webp){{ width="{width}" loading=lazy }}'


def _shown(kind: type) -> str:
    """The film of a class and the words below it."""
    return f"{_film(kind, 404)}\n\n*Right: {COMPARISONS[kind.__name__].words}.*"


def _source(kind: type) -> str:
    return f"Source: `{Path(inspect.getfile(kind)).relative_to(ROOT).as_posix()}`."


def material_page(kind: Any) -> str:
    """Of a constitutive law."""
    example = ", ".join(f"{name}: {value:.6g}" for name, value in kind().guess.items())
    parts = [
        f"# {kind.__name__}",
        _shown(kind),
        _described(kind),
        _source(kind),
        "## Parameters",
        _parameters(kind.parameters),
        "## In a configuration",
        f"```yaml\nphysics:\n  material:\n    class_path: {kind.__name__}\n    init_args: {{{example}}}\n```",
    ]
    return "\n\n".join(parts) + "\n"


def effect_page(kind: type[Effect]) -> str:
    """Of an effect or of a camera fault."""
    tried = "; ".join(", ".join(f"{name} = {value:g}" for name, value in probe.items()) for probe in kind.probes)
    nothing = ", ".join(f"{name} = {value:g}" for name, value in kind.null.items())
    parts = [f"# {kind.__name__}", _shown(kind), _described(kind), _source(kind)]
    parts += ["## What a recording shows", _sentence(kind.signature)]
    if kind.confused_with:
        similar = ", ".join(f"[`{name}`]({name}.md)" for name in kind.confused_with)
        parts.append(f"Easily confused with {similar}.")
    if kind.separating_experiment:
        parts.append(f"What would separate them: {kind.separating_experiment}.")
    parts += ["## Parameters", _parameters(kind.parameters)]
    parts.append(f"It vanishes at {nothing}; a diagnosis tries it at {tried}.")
    overlay = re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()
    text = (ROOT / "configs" / "effects" / f"{overlay}.yaml").read_text()
    parts += ["## In a configuration", f"By its name, `--config effects/{overlay}`:", f"```yaml\n{text}```"]
    return "\n\n".join(parts) + "\n"


def _described(kind: type) -> str:
    """The docstring, without what its other sections repeat."""
    text = inspect.getdoc(kind) or ""
    return re.split(r"\n(?:Args|Attributes|Raises|Signature):", text)[0].strip()


def _parameters(parameters: dict[str, Parameter]) -> str:
    rows = [
        f"| `{name}` | {parameter.label} | {parameter.unit} | {parameter.bounds[0]:g} to {parameter.bounds[1]:g} |"
        for name, parameter in parameters.items()
    ]
    return "\n".join(["| name | what it is | unit | between |", "|---|---|---|---|", *rows])


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "."
