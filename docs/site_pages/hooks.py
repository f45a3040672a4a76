"""What mkdocs calls: it adds the pages that are made when the site is built, and those that are kept elsewhere."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parents[1]))
from site_pages import config_keys, gallery, packages

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "validation" / "results"
ELSEWHERE = {
    "contributing.md": ROOT / "CONTRIBUTING.md",
    "changelog.md": ROOT / "CHANGELOG.md",
    "code_of_conduct.md": ROOT / "CODE_OF_CONDUCT.md",
    "security.md": ROOT / "SECURITY.md",
    **{f"validation/{path.name}": path for path in sorted(RESULTS.glob("*.md"))},
}
"""Pages of the site, and the files that they are."""


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are no files of ``docs/``."""
    pages = {name: path.read_text() for name, path in ELSEWHERE.items()} | gallery.pages() | config_keys.pages()
    for name, text in (pages | packages.pages()).items():
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
