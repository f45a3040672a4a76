"""Pictures of the page of ``explore`` for the documentation: every step of the drag story, and the story as a film.

    python -m validation.explore_pictures runs/demo_missing

opens the run of ``make demo``, does what a person would, and writes ``docs/explore/*.png`` and
``docs/explore/drag.gif``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import open_page
from tests.explore.hand import Hand, browser

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "explore"
COLOURS = 200
"""Of a picture: few enough for 150 kB, and no edge of the body changes."""
WIDTH = 880
"""Of the film [pixels]: what README shows at its full width."""
SHOWN = ("4", "6", "8", "9", "10", "11", "12")
"""Frames of the fall that are filmed."""
SETTLED = 1500
"""Milliseconds after which the page is drawn by software."""


class Film:
    """Pictures of a page, one after the other.

    Args:
        hand: on the page.
    """

    def __init__(self, hand: Hand):
        self.hand = hand
        self.frames: list[Image.Image] = []
        self.durations: list[int] = []

    def take(self, milliseconds: int, name: str | None = None) -> None:
        """A picture, and one of its own in the documentation where it has a name."""
        self.hand.page.wait_for_timeout(SETTLED)
        path = FOLDER / f"{name or 'last'}.png"
        self.hand.picture(path)
        image = Image.open(path).convert("RGB")
        path.unlink()
        if name:
            image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
        small = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
        self.frames.append(small.quantize(COLOURS, dither=Image.Dither.NONE))
        self.durations.append(milliseconds)

    def fall(self) -> None:
        """The body falls, as far as it is filmed."""
        for frame in SHOWN:
            self.hand.type("frame", frame)
            self.take(350)

    def write(self, path: Path) -> None:
        """The film as GIF."""
        first, *rest = self.frames
        first.save(path, save_all=True, append_images=rest, duration=self.durations, loop=0, optimize=True)


def story(run: str | Path) -> None:
    """Does what README tells, and takes pictures of it."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with Session.open(run) as session, browser() as pages:
        page = open_page(session, port=0)
        hand = pages()
        hand.open(page.url)
        hand.tab("Show")
        hand.tick("measured")
        hand.page.wait_for_timeout(5 * SETTLED)
        hand.tab("See")
        film = Film(hand)
        film.fall()
        film.take(1200, "1_late")
        hand.tab("Ask")
        hand.press("What would help?")
        hand.until(lambda: "Suggestions for step" in hand.text(), 900)
        film.take(1800, "2_what_would_help")
        hand.tick("Linear drag")
        hand.until(lambda: any(name.startswith("+ LinearDrag") for name, *_ in hand.steps()))
        film.take(1500, "3_ticked")
        hand.press("Fit")
        hand.until(lambda: any(name.startswith("fit") for name, *_ in hand.steps()), 900)
        hand.until(lambda: not session.busy)
        film.take(1800, "4_fitted")
        film.fall()
        hand.tab("Camera, frame")
        film.take(1500, "5_where")
        hand.tab("Keep")
        hand.press("Save overlay")
        hand.until(lambda: "Overlay saved" in hand.text())
        film.take(2000, "6_saved")
        film.write(FOLDER / "drag.gif")
        page.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run", help="folder of a run that lacks drag, such as runs/demo_missing")
    story(parser.parse_args().run)
