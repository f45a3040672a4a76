"""Pages of the documentation that are made when it is built: the gallery of effects and materials, from their classes;
the pages of results, and CONTRIBUTING.md and CHANGELOG.md, from where they are kept.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.render.camera_faults.base import Observation

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "validation" / "results"
ELSEWHERE = {
    "contributing.md": ROOT / "CONTRIBUTING.md",
    "changelog.md": ROOT / "CHANGELOG.md",
    **{f"validation/{path.name}": path for path in sorted(RESULTS.glob("*.md"))},
}
"""Pages of the site, and the files that they are."""


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are no files of ``docs/``."""
    pages = {name: path.read_text() for name, path in ELSEWHERE.items()} | gallery()
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links between the files of the repository lead to the pages of the site."""
    up = "../" * page.file.src_uri.count("/")
    for name, path in ELSEWHERE.items():
        source = re.escape(path.relative_to(ROOT).as_posix())
        markdown = re.sub(rf"\]\((?:\.\./)*{source}((?:#[^)]*)?)\)", rf"]({up}{name}\1)", markdown)
        markdown = re.sub(rf"\]\({re.escape(path.name)}\)", f"]({path.name})", markdown)
    return re.sub(r"\]\(docs/", f"]({up}", markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Docstrings name other classes and functions by roles, which nothing resolves here."""
    return re.sub(r":(?:attr|class|data|func|meth|mod):(?=<code>)", "", html)


def gallery() -> dict[str, str]:
    """A page for every material, effect and camera fault, and one that lists them, by their paths."""
    laws = [getattr(materials, name) for name in materials.__all__ if name not in ("Auto", "Material")]
    faults = [kind for kind in known_classes() if issubclass(kind, Observation)]
    effects = [kind for kind in known_classes() if kind not in faults]
    pages = {f"gallery/{kind.__name__}.md": effect_page(kind) for kind in known_classes()}
    pages |= {f"gallery/{kind.__name__}.md": material_page(kind) for kind in laws}
    listed = [
        "# Materials, effects and camera faults",
        "Each is a class in a file of its own; these pages are made from them.",
        "## Materials",
        _list(laws, [kind.__doc__.splitlines()[0] for kind in laws]),
        "## Effects",
        _list(effects, [kind.signature for kind in effects]),
        "## Camera faults",
        _list(faults, [kind.signature for kind in faults]),
        "How to add one of your own: [contributing](../contributing.md).",
    ]
    pages["gallery/index.md"] = "\n\n".join(listed) + "\n"
    return pages


def _list(kinds: list[type], said: list[str]) -> str:
    rows = [f"| [`{kind.__name__}`]({kind.__name__}.md) | {text} |" for kind, text in zip(kinds, said, strict=True)]
    return "\n".join(["| name | |", "|---|---|", *rows])


def material_page(kind: Any) -> str:
    """Of a constitutive law."""
    example = ", ".join(f"{name}: {value:.6g}" for name, value in kind().guess.items())
    parts = [
        f"# {kind.__name__}",
        _described(kind),
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
    parts = [f"# {kind.__name__}", _described(kind), "## What a recording shows", _sentence(kind.signature)]
    if kind.confused_with:
        alike = ", ".join(f"[`{name}`]({name}.md)" for name in kind.confused_with)
        parts.append(f"Easily confused with {alike}.")
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
