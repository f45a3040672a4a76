"""Mistakes in a configuration, each as one line: what is wrong, in which file, and the nearest right name."""

import argparse
import difflib
import inspect
import itertools
import re
import sys
from abc import ABC
from collections.abc import Iterable, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, get_args, get_origin

import yaml
from jsonargparse import ArgumentParser, DefaultHelpFormatter

from pacnerf_lpo.config_layers import SCENE_KEYS, flat, read_yaml, shown
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.named_configs import LIST_COMMAND, find_config

LISTED = 10
"""More classes than that are not listed where one is near enough to be meant."""

EXAMPLE = "scenes/torus"
"""The shipped scene whose values are shown where one is missing."""
EXAMPLES = {"data.root": "scenes/drop"}
"""What no shipped scene says."""


class HelpFormatter(argparse.RawDescriptionHelpFormatter, DefaultHelpFormatter):
    """Keeps the line breaks of a command's description, and with them its examples."""


def find_configs(args: Sequence[str]) -> tuple[list[str], list[Path]]:
    """A command line with a path in place of each configuration's name, and these files, each checked to be YAML."""
    split = [part for word in args for part in (word.split("=", 1) if word.startswith("--config=") else [word])]
    words, files = split[:1], []
    for option, value in itertools.pairwise(split):
        if option in ("--config", "-c"):
            files.append(_check_yaml(find_config(value, "--config")))
        words.append(str(files[-1]) if option in ("--config", "-c") else value)
    return words, files


def explain(error: Exception, parser: ArgumentParser, files: Sequence[Path]) -> UserInputError:
    """The parser's complaint as one line, with the nearest right name and the place of the wrong one in the files."""
    if isinstance(cause := cause_of(error), UserInputError):
        return cause
    text = str(error)
    where = ".".join(re.findall(r'Parser key "([^"]+)"', text))
    for explanation in (_unknown_key, _unknown_class, _missing, _wrong_type):
        if message := explanation(text, where, parser, files):
            return UserInputError(message)
    return UserInputError(" ".join(text.split()))


def cause_of(error: BaseException) -> BaseException:
    """The complaint of a class about its own arguments, out of what the parser made of it; else the error itself."""
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, UserInputError):
            return link
        link = link.__cause__ or link.__context__
    return error


def _unknown_key(text: str, where: str, parser: ArgumentParser, files: Sequence[Path]) -> str | None:
    known = [action.dest for action in parser._actions if action.dest]
    if found := re.search(r"unrecognized arguments: -*([^\s=]+)", text):
        key = found[1]
    elif found := re.search(r"Group '(.+)' does not accept option '(.+)'", text):
        key = f"{found[1]}.{found[2]}"
    elif found := re.search(r"class_path '([^']+)'[^']*Option '([^']+)' is not accepted", text):
        kind, within = resolve_name(found[1]), f"{where}.init_args."
        known = [within + name for name in inspect.signature(kind).parameters]
        key = within + found[2]
        if ABC in kind.__bases__:  # no class was given: the entry itself has a wrong key
            key, known = f"{where}.{found[2].split('.')[0]}", [f"{where}.class_path", f"{where}.init_args"]
    elif found := re.search(r"Option '([^']+)' is not accepted", text):
        key = found[1]
    else:
        return None
    return f"{_place(key.split('.')[-1], files)}unknown key {key}{nearest(key, known)}"


def _unknown_class(text: str, where: str, parser: ArgumentParser, files: Sequence[Path]) -> str | None:
    names = _class_names(parser, where)
    listing = ", ".join(names)
    if "is abstract" in text:
        return f"{where} is not chosen yet; give it a class_path first, one of {listing}"
    if found := re.search(r"Expected a dot import path string: (\S+)", text):
        near = nearest(found[1], names)
        known = f"; known are {listing}" if names and not (near and len(names) > LISTED) else ""
        own = f"; a class of your own has its module before it, MODULE.{found[1]}"
        return f"{_place(found[1], files)}{where}: there is no {found[1]}{known}{own}{near}"
    if found := re.search(r"Import path (\S+) does not correspond to a subclass of (\w+)", text):
        own = f"a class of your own has to inherit from {found[2]}"
        return f"{_place(found[1], files)}{where}: {found[1]} is no {found[2]}; known are {listing}, and {own}"
    absent = r"No module named [^\n]+|module [^\n]+ has no attribute [^\n]+"
    if found := re.search(rf"Problem with given class_path\s+'([^']+)':\s+({absent})", text):
        module, _, name = found[1].rpartition(".")
        looked = "modules are looked for among the installed packages and in the folder where you run the command"
        if module in sys.modules:
            looked = f"see its file{nearest(name, vars(sys.modules[module]))}"
        return f"{_place(found[1], files)}{where}: {found[1]} cannot be imported: {found[2].strip()}; {looked}"
    return None


def _missing(text: str, where: str, parser: ArgumentParser, files: Sequence[Path]) -> str | None:
    if found := re.search(r"Interpolation key '(.+)' not found\s+full_key: (\S+)", text):
        return f"{found[2]} refers to {found[1]}, which is not set; {_remedy([found[1]], files)}"
    if found := re.search(r"arguments are required: (.+)", text):
        names = found[1].split(", ")
        section = f" in section {where}.init_args" if where else ""
        keys = [f"{where}.init_args.{name}" for name in names] if where else names
        optional = any(action.dest == keys[0] and action.option_strings for action in parser._actions)
        return f"missing{section}: {found[1]}; {_remedy(keys, files)}" + (f", or give --{keys[0]}" if optional else "")
    return None


def _remedy(keys: Sequence[str], files: Sequence[Path]) -> str:
    """Into which file missing keys belong, with a value for each that an example has."""
    about_scene = [path for path in files if any(key in SCENE_KEYS for key in flat(read_yaml(path)))]
    place = shown(about_scene[-1]) if about_scene else "a --config file of your scene"
    known = {**flat(read_yaml(find_config("fit", ""))), **flat(read_yaml(find_config(EXAMPLE, "")))}
    values = [(key, known.get(key, known.get(f"{key}.class_path", EXAMPLES.get(key)))) for key in keys]
    examples = [f"{key.rpartition('.')[2]}: {value}" for key, value in values if value is not None]
    written = f", for example {', '.join(examples)} (all of it: `{LIST_COMMAND} {EXAMPLE}`)" if examples else ""
    return f"add to {place}{written}"


def _wrong_type(text: str, where: str, parser: ArgumentParser, files: Sequence[Path]) -> str | None:
    expected = dict.fromkeys(re.findall(r"Expected a <class '([^']+)'>", text))
    if not expected:
        return None
    value = re.search(r"(?:Got value|Given value): (.+)", text)
    wanted = " or ".join("null" if name == "NoneType" else name for name in expected)
    place = _place(where.split(".")[-1], files) if where else ""
    return f"{place}{where}: expected {wanted}, got {value[1] if value else 'something else'}"


def read_any_yaml(path: Path) -> Any:
    """What a file says that should be YAML. Raises UserInputError where it cannot be read."""
    try:
        return yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise UserInputError(f"{path}: {reason}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        raise UserInputError(f"{path}{line}: not valid YAML ({getattr(error, 'problem', error)})") from None


def _check_yaml(path: Path) -> Path:
    content = read_any_yaml(path)
    if content is not None and not isinstance(content, dict):
        raise UserInputError(f"{path}: expected sections such as `data:` at the top, found {type(content).__name__}")
    return path


def nearest(name: str, known: Iterable[str]) -> str:
    """``; did you mean NAME?`` with the nearest of the known names; empty where none is near."""
    match = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {match[0]}?" if match else ""


def _place(word: str, files: Sequence[Path]) -> str:
    """``file, line 3: `` of the last file that has the word; empty when none has."""
    for path in reversed(files):
        for number, line in enumerate(path.read_text().splitlines(), start=1):
            if re.search(rf"(?<![\w.]){re.escape(word)}(?![\w.])", line.split("#")[0]):
                return f"{path}, line {number}: "
    return ""


def _class_names(parser: ArgumentParser, key: str) -> list[str]:
    """Names of the concrete classes which the argument ``key`` accepts."""
    action = next((action for action in parser._actions if action.dest == key), None)
    hint: Any = getattr(action, "_typehint", None)
    bases = [
        base
        for base in (get_args(hint) or (hint,))
        if inspect.isclass(base) and not get_origin(base) and base is not type(None)
    ]
    return sorted({cls.__name__ for base in bases for cls in _concrete_subclasses(base)})


def _concrete_subclasses(base: type) -> list[type]:
    children: list[type] = type.__subclasses__(base)
    below = [one for child in children for one in _concrete_subclasses(child)]
    return below if inspect.isabstract(base) or ABC in base.__bases__ else [base, *below]
