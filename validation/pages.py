"""Make the pages of results of their JSON: ``python -m validation.pages [SUBJECT ...]``. Nothing is measured."""

from __future__ import annotations

import argparse
from importlib import import_module

from pacnerf_lpo.manifest import write_atomically
from validation.record import RESULTS, read

SUBJECTS = {
    "base_fit": "validation.hidden_effects.base_fit",
    "solver_error": "validation.solver_error",
    "diagnosed_videos": "validation.diagnosed_videos",
    "engine": "validation.engine",
    "explore": "validation.explore",
    "five_scenes": "validation.five_scenes",
    "gpu": "validation.gpu",
    "hidden_effects": "validation.hidden_effects.score",
    "identification": "validation.identification",
    "init_alone": "validation.init_alone",
    "rounds": "validation.rounds",
    "mattes": "validation.mattes",
    "own_recording": "validation.own_recording",
    "random_hands": "validation.random_hands",
    "real_measurements": "validation.real_measurements",
    "simulated_drops": "validation.simulated_drops",
    "three_views": "validation.three_views",
}
"""The module whose function ``page`` makes a subject's page of its record."""


def measured() -> list[str]:
    """The subjects that have a JSON."""
    return [subject for subject in SUBJECTS if (RESULTS / f"{subject}.json").is_file()]


def page(subject: str) -> str:
    """The page of a subject."""
    return import_module(SUBJECTS[subject]).page(read(subject))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=f"of {', '.join(SUBJECTS)}; all by default")
    for subject in parser.parse_args().subjects or measured():
        if subject not in measured():
            parser.error(f"{subject}: no such result in {RESULTS}")
        write_atomically(RESULTS / f"{subject}.md", page(subject).encode())
        print(RESULTS / f"{subject}.md")


if __name__ == "__main__":
    main()
