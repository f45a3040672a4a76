"""What the site makes from classes and contracts is complete: keys of configurations, films, the packages."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))
from site_pages import config_keys, films, packages  # noqa: E402
from site_pages.scenes import COMPARISONS  # noqa: E402

from pacnerf_lpo.diagnosis.catalogue import known_classes  # noqa: E402
from pacnerf_lpo.mpm import materials  # noqa: E402

LARGEST_FILM = 150_000
"""Of a page of the gallery [bytes]."""
CONFIGS = sorted((ROOT / "configs").glob("**/*.yaml"))
NAMED = {kind.__name__: kind for role in config_keys.CHOICES for kind in config_keys.concrete(role)}
NAMED |= {kind.__name__: kind for kind in config_keys.reached(config_keys.AbstractPhase)}
SECTIONS = {name: kind for name, (kind, _) in config_keys.SECTIONS.items() if name != "phases"}


@pytest.fixture(scope="module")
def listed() -> set[str]:
    """The keys on the pages, as class and name."""
    return set(re.findall(r'<span id="([\w.]+)">', "".join(config_keys.pages().values())))


def used(content: Any, kind: type | None = None) -> Iterator[str]:
    """Every key of a configuration, as class and name. Keys below a class that another file names are of any class."""
    if isinstance(content, list):
        for entry in content:
            yield from used(entry)
    if not isinstance(content, dict):
        return
    if "class_path" in content or "init_args" in content:
        named = content.get("class_path")
        for name, value in (content.get("init_args") or {}).items():
            yield f"{named or '*'}.{name}"
            yield from used(value)
    elif kind is not None:
        for name, value in content.items():
            yield f"{kind.__name__}.{name.removesuffix('+')}"
            yield from used(value)


def keys_of(path: Path) -> Iterator[str]:
    content = yaml.safe_load(path.read_text()) or {}
    if isinstance(content, list):
        yield from used(content)
        return
    for section, value in content.items():
        if section == "phases":
            assert set(value) <= set(config_keys.ROLES)
            for phase in value.values():
                yield from used(phase)
        elif section in SECTIONS:
            yield from used(value, SECTIONS[section])
        else:
            yield f"top.{section}"


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_key_of_a_shipped_configuration_is_on_a_page(path: Path, listed: set[str]):
    names = {key.partition(".")[2] for key in listed}
    for key in keys_of(path):
        kind, _, name = key.partition(".")
        assert name in names if kind == "*" else key in listed, key


def test_every_key_says_what_it_means():
    for kind in [*NAMED.values(), *SECTIONS.values()]:
        for key in config_keys.keys(kind):
            words = config_keys.BRACKETS.sub("", key.meaning)
            assert re.search("[a-z]", words) or kind is config_keys.Trainer, f"{kind.__name__}.{key.name}"


def test_every_material_and_effect_has_a_small_film():
    laws = {name for name in materials.__all__ if name not in ("Auto", "Material")}
    assert set(COMPARISONS) == laws | {kind.__name__ for kind in known_classes()}
    assert {path.stem for path in films.FOLDER.glob("*.webp")} == set(COMPARISONS)
    assert all(0 < path.stat().st_size <= LARGEST_FILM for path in films.FOLDER.glob("*.webp"))


def test_films_differ_in_what_they_are_about():
    for name, compared in COMPARISONS.items():
        left, right = compared.left, compared.right
        assert left.body == right.body and left.place == right.place and left.velocity == right.velocity
        changed = {type(right.material).__name__, *(type(effect).__name__ for effect in right.effects)}
        assert name in changed and not left.effects, name


def test_the_picture_has_every_package():
    found = {name for layer in packages.layers() for name in layer}
    package = ROOT / "pacnerf_lpo"
    inside = {path.stem for path in package.glob("*.py")} | {path.parent.name for path in package.glob("*/__init__.py")}
    assert found == inside - {"__init__"}
    assert all(f">{name}</text>" in packages.picture() for name in found)
