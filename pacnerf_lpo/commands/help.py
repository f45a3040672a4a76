"""What ``pacnerf-lpo COMMAND --help`` says, read from the source files: no command is loaded in order to describe it.

The arguments and the docstring of a command's function ``run`` are its help; of ``fit``, those of the classes that the
sections of its configuration make.
"""

import ast
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
        options = [_option(f"--{name}", text) for name, text in OPTIONS.items()]
        for name, path in SECTIONS.items():
            home, _, kind = path.rpartition(".")
            described = _definition(f"pacnerf_lpo.{home}", kind)
            init = next(one for one in described.body if isinstance(one, ast.FunctionDef) and one.name == "__init__")
            options.append(f"\n{name}: {(ast.get_docstring(described) or '').partition(chr(10))[0]}")
            options += [_option(f"--{name}.{argument}", text) for argument, _, text in _arguments(init, described)]
        return "\n".join([DESCRIPTION, "", "options:", *options, "", FIT_MORE])
    run = _definition(module, "run")
    arguments = list(_arguments(run, run))
    said = (ast.get_docstring(run) or "").partition("\n\nArgs:")[0]
    required = [name.upper() for name, needed, _ in arguments if needed]
    usage = " ".join(["usage: pacnerf-lpo", command, *required, "[options]"])
    lines = [_option(name.upper() if needed else f"--{name}", text) for name, needed, text in arguments]
    return "\n".join([usage, "", said, "", "arguments and options:", *lines])


def _definition(module: str, name: str) -> Any:
    """The function or class of a module, which is not imported."""
    path = Path(pacnerf_lpo.__file__).parent.joinpath(*module.split(".")[1:]).with_suffix(".py")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return next(n for n in tree.body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and n.name == name)


def _arguments(function: ast.FunctionDef, documented: Any) -> Iterator[tuple[str, bool, str]]:
    """Of every argument its name, whether it is required, and its description with the type and the default, where that
    is a value rather than the name of one.
    """
    said = {
        name.strip(): entry.description or ""
        for entry in parse(ast.get_docstring(documented) or "").params
        for name in entry.arg_name.split(",")
    }
    arguments = [argument for argument in function.args.args if argument.arg != "self"]
    missing = len(arguments) - len(function.args.defaults)
    for index, argument in enumerate(arguments):
        default = "None" if index < missing else ast.unparse(function.args.defaults[index - missing])
        known = (
            "required" if index < missing else "" if default.isupper() or default == "None" else f"default {default}"
        )
        kind = "" if argument.annotation is None else ast.unparse(argument.annotation).removesuffix(" | None")
        text = " ".join(said.get(argument.arg, "").split())
        yield argument.arg, index < missing, f"{text} ({', '.join(filter(None, (kind, known)))})".strip()


def _option(name: str, text: str) -> str:
    head, said = f"  {name}", textwrap.indent(textwrap.fill(text, WIDTH - COLUMN), " " * COLUMN)
    return f"{head:<{COLUMN}}{said[COLUMN:]}" if len(head) < COLUMN else f"{head}\n{said}"
