"""What ``pacnerf-lpo COMMAND --help`` says, read from the source files: no command is loaded in order to describe it.

The arguments and the docstring of a command's function ``run`` are its help; of ``fit``, those of the classes that the
sections of its configuration make.
"""

import ast
import textwrap
from collections.abc import Iterator
from pathlib import Path

from docstring_parser import parse

import pacnerf_lpo
from pacnerf_lpo.fit_options import DESCRIPTION, OPTIONS

SECTIONS = {
    "data": "data.video_data.VideoData",
    "physics": "mpm.physics.Physics",
    "outer_loop": "outer_loop.OuterLoop",
}
"""Sections of the configuration of ``fit`` by the class that each makes."""
COLUMN, WIDTH = 26, 100
FIT_MORE = """The sections phases.static, phases.velocity and phases.physics, and where wanted phases.law and
phases.correction, each have a class_path and init_args; trainer has the options of Lightning's Trainer.
`pacnerf-lpo fit --help all` lists every key with its type, `pacnerf-lpo configs fit` shows the usual values."""


def command_help(command: str, module: str) -> str:
    """The help of a command whose function ``run`` is in a module."""
    if command == "fit":
        sections = [section for name, path in SECTIONS.items() for section in _section(name, path)]
        options = [_option(f"--{name}", text) for name, text in OPTIONS.items()]
        return "\n".join([DESCRIPTION, "", "options:", *options, *sections, "", FIT_MORE])
    run = _definition(module, "run")
    required = [argument.upper() for argument, default, _, _ in _arguments(run, run) if default is None]
    said = (ast.get_docstring(run) or "").partition("\n\nArgs:")[0]
    usage = " ".join(["usage: pacnerf-lpo", command, *required, "[options]"])
    lines = [
        _option(name.upper() if default is None else f"--{name}", _told(text, kind, default))
        for name, default, kind, text in _arguments(run, run)
    ]
    return "\n".join([usage, "", said, "", "arguments and options:", *lines])


def _section(name: str, path: str) -> Iterator[str]:
    module, _, kind = path.rpartition(".")
    described = _definition(f"pacnerf_lpo.{module}", kind)
    assert isinstance(described, ast.ClassDef)
    init = next(node for node in described.body if isinstance(node, ast.FunctionDef) and node.name == "__init__")
    yield f"\n{name}: {(ast.get_docstring(described) or '').partition(chr(10))[0]}"
    for argument, default, annotation, text in _arguments(init, described):
        yield _option(f"--{name}.{argument}", _told(text, annotation, default))


def _definition(module: str, name: str) -> ast.FunctionDef | ast.ClassDef:
    """The function or class of a module, which is not imported."""
    path = Path(pacnerf_lpo.__file__).parent.joinpath(*module.split(".")[1:]).with_suffix(".py")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return next(n for n in tree.body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and n.name == name)


def _arguments(
    function: ast.FunctionDef | ast.ClassDef, documented: ast.FunctionDef | ast.ClassDef
) -> Iterator[tuple[str, str | None, str, str]]:
    """Name, default (None: required), type and description of every argument."""
    assert isinstance(function, ast.FunctionDef)
    said = {
        name.strip(): entry.description or ""
        for entry in parse(ast.get_docstring(documented) or "").params
        for name in entry.arg_name.split(",")
    }
    arguments = [argument for argument in function.args.args if argument.arg != "self"]
    missing = len(arguments) - len(function.args.defaults)
    for index, argument in enumerate(arguments):
        default = None if index < missing else ast.unparse(function.args.defaults[index - missing])
        kind = "" if argument.annotation is None else ast.unparse(argument.annotation)
        yield argument.arg, default, kind, " ".join(said.get(argument.arg, "").split())


def _told(text: str, kind: str, default: str | None) -> str:
    """The description with the type and the default, where that is a value rather than the name of one."""
    known = "required" if default is None else "" if default.isupper() or default == "None" else f"default {default}"
    return f"{text} ({', '.join(part for part in (kind.removesuffix(' | None'), known) if part)})".strip()


def _option(name: str, text: str) -> str:
    head, said = f"  {name}", textwrap.indent(textwrap.fill(text, WIDTH - COLUMN), " " * COLUMN)
    return f"{head:<{COLUMN}}{said[COLUMN:]}" if len(head) < COLUMN else f"{head}\n{said}"
