"""Pages that list every key of a configuration, made from the classes that the keys configure."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import docstring_parser
from pytorch_lightning import Trainer

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo.cli import NOT_CONFIGURABLE, PhaseCLI
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.ground import Ground
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.outer_loop import OuterLoop
from pacnerf_lpo.phases.base import AbstractPhase

PACKAGE = "pacnerf_lpo"
SECTIONS: dict[str, tuple[type, str]] = {
    "data": (
        VideoModule,
        "The recording: where it is, which views and frames count, and the box that holds the body.",
    ),
    "physics": (Physics, "The physical model: material, ground, effects, and how finely time is resolved."),
    "phases": (AbstractPhase, "What is computed, phase by phase. Each is a class with its `init_args`."),
    "outer_loop": (OuterLoop, "How often identification and correction alternate, and where the run is kept."),
    "trainer": (Trainer, "Arguments of the `Trainer` of PyTorch Lightning, whose documentation explains them."),
}
ROLES = {
    "static": "`StaticGridModule`: the voxel radiance field of frame 0",
    "velocity": "`VelocityModule`: the initial velocity",
    "law": "`LawChoice`: the constitutive law, where `physics.material` is `auto`",
    "physics": "`PhysicsIDModule`: the parameters of the material and of the effects",
    "correction": "`LPOModule` or `GridOptimizationModule`: the particles; leave it out for none",
}
CHOICES = (Material, Ground, Effect)
BRACKETS = re.compile(r" ?\[([^\]\[]+)\]")
UNIT = re.compile(r"(?=.*[A-Za-z])[^, ]+( [^, ]+)?")
BAR = "\\|"
HEAD = "| key | type | default | unit | meaning |\n|---|---|---|---|---|"


@dataclass(frozen=True)
class Key:
    """One argument of a class."""

    name: str
    annotation: Any
    default: Any
    unit: str
    meaning: str


def concrete(kind: type) -> list[type]:
    """The classes of the package that a configuration may name where ``kind`` is expected, by name."""
    if kind is Effect:
        return sorted(known_classes(), key=lambda one: one.__name__)
    found = {kind} if not inspect.isabstract(kind) and kind.__module__.startswith(PACKAGE) else set()
    for below in kind.__subclasses__():
        found |= set(concrete(below))
    return sorted((one for one in found if one.__module__.startswith(PACKAGE)), key=lambda one: one.__name__)


def packaged(annotation: Any) -> Iterator[type]:
    """Classes of the package in an annotation."""
    if isinstance(annotation, type) and annotation.__module__.startswith(PACKAGE):
        yield annotation
    for part in get_args(annotation):
        yield from packaged(part)


@lru_cache
def keys(kind: type) -> tuple[Key, ...]:
    """The arguments of a class, with what its docstring says about them."""
    hints, meanings = get_type_hints(kind.__init__), _meanings(kind)
    parameters = kind.parameters if issubclass(kind, Material | Effect | Ground) else {}
    found = []
    for name, argument in list(inspect.signature(kind).parameters.items()):
        if kind is Trainer and name in NOT_CONFIGURABLE:
            continue
        meaning = meanings.get(name, "")
        if name in parameters:
            unit, label = parameters[name].unit, parameters[name].label
            meaning = meaning if re.search("[a-z]{2}", BRACKETS.sub("", meaning)) else f"{label} {meaning}".strip()
        else:
            unit = ", ".join(dict.fromkeys(one for one in BRACKETS.findall(meaning) if UNIT.fullmatch(one)))
        found.append(Key(name, hints.get(name, Any), argument.default, unit, meaning))
    return tuple(found)


def _meanings(kind: type) -> dict[str, str]:
    """What the docstring says about each argument; what it leaves to a base class, from there."""
    if not kind.__module__.startswith(PACKAGE):
        return {}
    parsed = docstring_parser.parse(inspect.getdoc(kind) or "", docstring_parser.DocstringStyle.GOOGLE)
    found = {
        name.strip(): " ".join((entry.description or "").split())
        for entry in parsed.params
        for name in entry.arg_name.split(",")
    }
    bases = {base.__name__: base for base in kind.__mro__[1:-1] if base.__module__.startswith(PACKAGE)}
    for name, words in found.items():
        base = re.fullmatch(r"see :class:`(\w+)`\.", words)
        if base and base[1] in bases:
            found[name] = _meanings(bases[base[1]])[name]
    return _meanings(kind.__mro__[1]) | found


def _plain(words: str) -> str:
    """Words of a docstring as Markdown."""
    words = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", words.replace("``", "`"))
    return re.sub(r"<(\w+)>", r"&lt;\1&gt;", re.sub(r"\bNone\b", "`null`", words))


def reached(kind: type) -> list[type]:
    """A class, and all classes that its keys can name, each once; those of :data:`CHOICES` have places of their own."""
    found: list[type] = []

    def visit(one: type) -> None:
        for candidate in concrete(one):
            if candidate not in found:
                found.append(candidate)
                for key in keys(candidate):
                    for below in packaged(key.annotation):
                        if below not in CHOICES:
                            visit(below)

    visit(kind)
    return found


def type_words(annotation: Any) -> str:
    """An annotation for people."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation is Any:
        return "any"
    if annotation is NoneType:
        return "`null`"
    if origin is Literal:
        return " or ".join(dict.fromkeys(f"`{part}`" for part in parts))
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(type_words, parts)))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"mapping from {type_words(parts[0])} to {type_words(parts[1])}"
    if origin is tuple and Ellipsis not in parts:
        return f"list of {len(parts)} {type_words(parts[0])}"
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return f"list of {type_words(parts[0])}"
    if isinstance(annotation, type) and annotation.__module__.startswith(PACKAGE):
        page = "physics.md" if annotation in CHOICES else "phases.md"
        return f"[{annotation.__name__}]({page}#{annotation.__name__.lower()})"
    return getattr(annotation, "__name__", str(annotation).replace("typing.", ""))


def _default(value: Any) -> str:
    if value is inspect.Parameter.empty:
        return "required"
    if value is None:
        return "`null`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{value:g}`"
    if isinstance(value, list | tuple):
        return f"`[{', '.join(f'{one:g}' if isinstance(one, float) else str(one) for one in value)}]`"
    return f"`{value}`" if isinstance(value, str | int) else f"`{type(value).__name__}`"


def table(kind: type) -> str:
    """The keys of a class."""
    if not keys(kind):
        return "It has no keys."
    rows = []
    for key in keys(kind):
        cells = [f'<span id="{kind.__name__}.{key.name}">`{key.name}`</span>', type_words(key.annotation)]
        meaning = BRACKETS.sub(lambda found: "" if UNIT.fullmatch(found[1]) else found[0], key.meaning)
        cells += [_default(key.default), key.unit, _plain(meaning)]
        rows.append(f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |")
    return "\n".join([HEAD, *rows])


def _described(kind: type, level: str = "##") -> list[str]:
    first = (inspect.getdoc(kind) or "").split("\n\n")[0]
    return [f"{level} {kind.__name__}", _plain(first), table(kind)]


def _section(name: str) -> str:
    kind, words = SECTIONS[name]
    parts = [f"# `{name}`", words]
    if name == "phases":
        parts.append("\n".join([f"- `phases.{role}`: {said}" for role, said in ROLES.items()]))
        for one in reached(kind):
            parts += _described(one)
    elif name == "physics":
        parts += [table(kind)]
        for choice, title in zip(CHOICES, ("a law", "the boundary at the ground", "further physics"), strict=True):
            parts += [f"## {choice.__name__}", f"A class of {title}, by its short name and `init_args`:"]
            for one in concrete(choice):
                parts += _described(one, "###")
    else:
        parts.append(table(kind))
    return "\n\n".join(parts) + "\n"


def _first_page() -> str:
    parser = PhaseCLI(["--config", "fit", "--config", "demo"], VideoModule, Physics).parser
    alone = [one for one in parser._actions if re.fullmatch(r"\w+", one.dest) and one.help and one.dest not in SECTIONS]
    rows = [
        f'| <span id="top.{one.dest}">`{one.dest}`</span> | {(one.help or "").replace("%%", "%").split(" (type")[0]} |'
        for one in alone
        if one.dest not in ("help", "config", "print_config") and not (one.help or "").startswith("==")
    ]
    listed = "\n".join(f"- [`{name}`]({name}.md): {words}" for name, (_, words) in SECTIONS.items())
    return f"""# Every key of a configuration

A configuration is a stack of YAML files. `pacnerf-lpo fit --config A --config B --data.frames 20` reads A, then B, then
the command line; each changes only what it names. A file is given by its path or by the name of a shipped one
(`pacnerf-lpo configs` lists them). A run keeps the whole stack as one file, `config.yaml`.

{listed}

A key of a class is written below `init_args`: `phases.velocity.init_args.max_iterations`. `class_path` names the class,
by its short name or, for one of your own, by its module (`my_effect.Lorentz`). These pages are made from the classes.

## Keys of no section

| key | meaning |
|---|---|
{chr(10).join(rows)}
"""


def pages() -> dict[str, str]:
    """All pages, by their paths."""
    sections = {f"configuration/{name}.md": _section(name) for name in SECTIONS}
    return {"configuration/index.md": _first_page(), **sections}
