"""A result is one JSON, which says when, with which commit and on which machine it was made, and a page made of it."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pacnerf_lpo.manifest import write_atomically

RESULTS = Path(__file__).parent / "results"
Record = dict[str, Any]


def made() -> dict[str, str]:
    """Date, commit (with a + where the tree has changes) and machine of a measurement that begins now."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=RESULTS, capture_output=True, text=True, check=True).stdout.strip()

    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    machine = f"{platform.machine()}, {os.cpu_count()} cores"
    return {
        "date": time.strftime("%Y-%m-%d"),
        "commit": git("rev-parse", "--short", "HEAD") + changed,
        "machine": machine,
    }


def origin(record: Mapping[str, Any], subject: str, measured_by: str) -> str:
    """The first paragraph of every page."""
    return (
        f"{record['date']}, commit {record['commit']}, machine: {record['machine']}. Measured by {measured_by}; "
        f"`python -m validation.pages {subject}` makes this page of `{subject}.json`."
    )


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in [head, ["---"] * len(head), *rows])


def read(subject: str) -> Record:
    """The JSON of a subject."""
    return json.loads((RESULTS / f"{subject}.json").read_text(encoding="utf-8"))


def keep(subject: str, record: Record, page: Callable[[Record], str], text: str = "") -> None:
    """Write the JSON (as ``text``, where another form than the indented one reads better) and the page."""
    text = text or json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    write_atomically(RESULTS / f"{subject}.json", text.encode())
    write_atomically(RESULTS / f"{subject}.md", page(json.loads(text)).encode())
