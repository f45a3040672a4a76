"""A page as a headless Chromium sees it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

COMMAND = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=4000", "--dump-dom")
FRAMES = "<script>window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);</script>"
"""Frames by the clock: without a screen, and in virtual time, a browser may show none."""


def dom(page: str, probe: str, folder: Path, *options: str) -> str:
    """The document after its scripts and those of a probe, which ends the body, have run; skips without a browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no chromium here")
    path = folder / "probe.html"
    path.write_text(page.replace("<head>", f"<head>{FRAMES}", 1).replace("</body>", probe))
    command = [browser, *COMMAND, *options, path.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
