"""Random hands on the page of ``explore``: what they find, and what they cost.

    python -m validation.random_hands --run runs/demo_missing --minutes 60 --keep

Opens a run in a headless Chromium and does what the test of the page does in a minute, and now and then asks, fits and
stops: drags sliders, presses buttons, ticks boxes, in any order. Counted are errors that no message explains, pages
with a NaN, and errors of the browser; the memory of the process is noted every minute.
"""

from __future__ import annotations

import argparse
import random
import re
import time
from pathlib import Path

import psutil

from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import open_page
from tests.explore.hand import Hand, browser
from tests.explore.test_page_browser import DRAWN, random_act
from validation.record import Record, keep, made, origin

ASKING = 0.01
"""Part of the acts that ask a question."""
UNEXPLAINED, NAN = "mistake of the program", re.compile(r"\b(NaN|nan)\b")


def ask(hand: Hand) -> None:
    """Press what asks and stops, as far as it can be pressed."""
    hand.tab("Ask")
    for name in ("What would help?", "Fit", "Stop"):
        button = hand.page.get_by_role("button", name=name, exact=True)
        if button.is_visible() and button.is_enabled():
            button.click()
        hand.page.wait_for_timeout(3000)


def measure(run: Path, minutes: float, seed: int) -> Record:
    """What hands find in some minutes, see the head of this file."""
    found: Record = {**made(), "minutes": minutes, "acts": 0, "unexplained": 0, "nan": 0}
    dice, memory = random.Random(seed), []
    with Session.open(run, jobs=1) as session, browser() as pages:
        page = open_page(session, port=0)
        hand = pages()
        hand.open(page.url)
        began = time.monotonic()
        while (passed := time.monotonic() - began) < 60 * minutes:
            if passed >= 60 * len(memory):
                memory.append(round(psutil.Process().memory_info().rss / 1e6))
                print(
                    f"{passed / 60:.0f} min, {found['acts']} acts, {len(session.steps)} steps, {memory[-1]} MB",
                    flush=True,
                )
            hand.dismiss()
            if dice.random() < ASKING:
                ask(hand)
            random_act(hand, dice)
            drawn = hand.page.evaluate(DRAWN)
            found["acts"] += 1
            found["unexplained"] += UNEXPLAINED in drawn
            found["nan"] += NAN.search(drawn) is not None
        found |= {"steps": len(session.steps), "browser": hand.wrong, "memory_MB": memory}
        page.close()
    return found


def page(found: Record) -> str:
    """The record as Markdown."""
    memory = found["memory_MB"]
    sixths = ", ".join(str(memory[min(k * len(memory) // 6, len(memory) - 1)]) for k in range(1, 7))
    return "\n".join(
        [
            "# Random hands on the page of explore",
            "",
            origin(found, "random_hands", "`python -m validation.random_hands --keep`"),
            "",
            *([found["note"], ""] if "note" in found else []),
            f"In {found['minutes']:g} minutes {found['acts']} acts and {found['steps']} steps of the history: "
            f"{found['unexplained']} pages with an error that no message explains, {found['nan']} with a NaN, "
            f"{len(found['browser'])} errors of the browser.",
            "",
            f"Memory of the process: {memory[0]} MB at the beginning; after each sixth of the time {sixths} MB. "
            "Effects that are tried for the first time compile kernels, which stay.",
            "",
        ]
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--run", type=Path, default=Path("runs/demo_missing"), help="a run and its diagnosis")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--keep", action="store_true", help="write validation/results/random_hands.json and its page")
    given = parser.parse_args()
    found = measure(given.run, given.minutes, given.seed)
    print(page(found))
    if given.keep:
        keep("random_hands", found, page)


if __name__ == "__main__":
    main()
