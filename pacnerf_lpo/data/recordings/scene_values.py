"""The values of a ``scene.yaml`` with the comments that say where each comes from."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import yaml

HEADER = re.compile(r"# ([a-z]+): (.+)")
"""A line at the top of the file about something that is no value, such as the cameras."""
MORE = "#   "
"""A line that goes on with the one before."""


@dataclass(frozen=True)
class Value:
    """One value of the file: its dotted key, as it is written, and the comment on it ("" where there is none)."""

    key: str
    text: str
    why: str


def header(text: str) -> dict[str, str]:
    """What the comments at the top of the file say, by their first words."""
    found: dict[str, str] = {}
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if match := HEADER.fullmatch(line):
            found[match[1]] = match[2]
        elif line.startswith(MORE) and found:
            found[list(found)[-1]] += f"; {line.removeprefix(MORE)}"
    return found


def annotated(text: str) -> list[Value]:
    """Every value in the order of the file.

    A value without a comment has that of the value before it in its section, else that of the section.
    """
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    return [] if root is None else list(_walk(root, text, text.splitlines(), "", ""))


def _walk(node: yaml.Node, text: str, lines: list[str], key: str, why: str) -> Iterator[Value]:
    if isinstance(node, yaml.ScalarNode) or getattr(node, "flow_style", False):
        yield Value(key, text[node.start_mark.index : node.end_mark.index].strip(), why)
    elif isinstance(node, yaml.SequenceNode):
        for number, item in enumerate(node.value):
            yield from _walk(item, text, lines, f"{key}[{number}]", why)
    elif isinstance(node, yaml.MappingNode):
        before = why
        for name, value in node.value:
            leaf = isinstance(value, yaml.ScalarNode) or value.flow_style
            own = _comment(lines, value.end_mark if leaf else name.end_mark) or _comment_above(lines, name.start_mark)
            yield from _walk(value, text, lines, f"{key}.{name.value}" if key else name.value, own or before)
            before = own if own and leaf else before


def _comment(lines: list[str], mark: yaml.Mark) -> str:
    """What follows a # behind a place in the file."""
    return lines[mark.line][mark.column :].partition("#")[2].strip() if mark.line < len(lines) else ""


def _comment_above(lines: list[str], mark: yaml.Mark) -> str:
    """Lines of comment directly above an indented key."""
    found: list[str] = []
    for line in reversed(lines[: mark.line] if mark.column else []):
        if not line.strip().startswith("#"):
            break
        found.insert(0, line.strip().lstrip("# "))
    return " ".join(found)
