"""A person's hand on a page in a headless Chromium: it opens, presses, ticks, drags, and looks."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

SOFTWARE = ("--no-sandbox", "--enable-unsafe-swiftshader")
"""A machine without a graphics card: WebGL by software, the page composed without it."""
PATIENCE = 120.0
"""Seconds that a hand waits: a loaded machine without a graphics card is slow."""


class Hand:
    """On one page.

    wrong: what the browser complained of.
    """

    def __init__(self, page: Any):
        self.page = page
        self.wrong: list[str] = []
        page.set_default_timeout(1000 * PATIENCE)
        page.on("pageerror", lambda error: self.wrong.append(str(error)))

    def open(self, url: str) -> None:
        """Open a page and wait until its model is drawn."""
        self.page.goto(url)
        self.page.get_by_text("Model", exact=True).wait_for()
        self.until(lambda: self.steps())
        self.page.get_by_text("Software WebGL").wait_for()
        self.dismiss()

    def dismiss(self) -> None:
        """Close what the page has said; some of it closes by itself meanwhile."""
        self.page.locator(".mantine-Notification-closeButton").evaluate_all("all => all.forEach(one => one.click())")

    def tab(self, name: str) -> None:
        """Go to a tab."""
        self.page.get_by_role("tab", name=name).click()

    def press(self, name: str) -> None:
        """Press a button."""
        self.page.get_by_role("button", name=name, exact=True).click()

    def tick(self, label: str) -> None:
        """Tick or untick a box by its label."""
        self.row(label).get_by_role("checkbox").click()

    def type(self, label: str, text: str) -> None:
        """Write into a field by its label."""
        self.row(label).locator("input").last.fill(text)

    def row(self, label: str) -> Any:
        """The field or slider with a label that begins so."""
        return self.page.locator(f"xpath=//label[starts-with(normalize-space(.), '{label}')]/../../..").first

    def drag(self, label: str, share: float, steps: int = 5) -> None:
        """Drag a slider to a share of its length."""
        box = self.row(label).locator(".mantine-Slider-trackContainer").bounding_box()
        thumb = self.row(label).locator(".mantine-Slider-thumb").bounding_box()
        mouse = self.page.mouse
        mouse.move(thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2)
        mouse.down()
        mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2, steps=steps)
        mouse.up()

    def steps(self) -> list[tuple[str, float, float]]:
        """The history as one reads it: name, fitted and held-out error of every step, NaN where there is a dash."""
        found = []
        for cells in self.page.locator(".steps tr[data-go]").evaluate_all(
            # not innerText: of a row that the page is replacing just now, that has no line breaks
            "rows => rows.map(row => [...row.cells].map("
            "cell => [...cell.childNodes].map(node => node.textContent).join(' ').trim()))"
        ):
            fitted, held = cells[3].split()
            found.append(
                (cells[1], *(float("nan") if text == "\N{EN DASH}" else float(text) for text in (fitted, held)))
            )
        return found

    def text(self) -> str:
        """All that can be read."""
        return self.page.locator("body").inner_text()

    def until(self, what: Callable[[], Any], seconds: float = PATIENCE) -> Any:
        """Wait until something is so; returns it."""
        end = time.monotonic() + seconds
        while not (found := what()):
            assert time.monotonic() < end, f"not so after {seconds} s; the page says: {self.text()}"
            self.page.wait_for_timeout(100)
        return found

    def picture(self, path: Path) -> None:
        """What is seen, as PNG."""
        self.page.screenshot(path=str(path))


@contextmanager
def browser() -> Iterator[Callable[..., Hand]]:
    """Pages in a headless Chromium, of a size [pixels]; skips without the driver or the browser."""
    driver = pytest.importorskip("playwright.sync_api", reason="no playwright here")
    path = shutil.which("chromium") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium here")
    with driver.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=path, args=list(SOFTWARE))
        try:
            yield lambda width=1280, height=800, **more: Hand(
                chromium.new_page(viewport={"width": width, "height": height}, **more)
            )
        finally:
            chromium.close()
