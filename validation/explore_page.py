"""How long a hand waits on the page of ``explore``, in a real browser, and how many frames a second it shows.

    python -m validation.explore_page runs/demo_missing

A slider of the page is set again and again; the time runs in the browser, from the event to the page with the new
history and picture: on the coarse body, and refined when the hand rests. Playing counts pictures that the page shows.
Without a graphics card the browser draws by software, which takes cores from the simulation. Prints one
JSON line; :mod:`validation.explore` keeps it.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import open_page
from pacnerf_lpo.explore.page.page import REST
from tests.explore.hand import Hand, browser

PLAYED = 5.0
"""Seconds for which playing is watched."""
MOVED = """([label, value]) => new Promise((done) => {
  const find = (node) => node.textContent.startsWith(label);
  const row = [...document.querySelectorAll("label")].find(find).closest("[class*=Flex-root]");
  const input = row.querySelector("input:not([type=hidden])");
  const now = () => document.querySelector(".steps tr.now").innerHTML;
  const before = now(), began = performance.now();
  let coarse = null;
  const watch = new MutationObserver(() => {
    if (now() !== before && coarse === null) coarse = performance.now();
    if (coarse !== null && !now().includes(" ~")) {
      watch.disconnect();
      requestAnimationFrame(() => done([coarse - began, performance.now() - began]));
    }
  });
  watch.observe(document.body, { subtree: true, childList: true, characterData: true });
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(input, value);
  input.dispatchEvent(new Event("input", { bubbles: true }));
})"""
COUNTED = """(seconds) => new Promise((done) => {
  let pictures = 0;
  const watch = new MutationObserver(() => pictures++);
  watch.observe(document.querySelector("img"), { attributes: true, attributeFilter: ["src"] });
  setTimeout(() => { watch.disconnect(); done(pictures / seconds); }, 1000 * seconds);
})"""


def measure(run: str | Path, count: int = 30) -> dict[str, Any]:
    """Times from the event of a slider to the page that is drawn anew [s, medians], and pictures per second of playing.

    Args:
        run: folder that was fitted.
        count: changes.
    """
    random = np.random.default_rng(0)
    with Session.open(run) as session, browser() as pages:
        page = open_page(session, port=0)
        hand: Hand = pages()
        hand.open(page.url)
        hand.until(lambda: not session.busy, 900)  # first answers are prepared in the background
        middle = next(setting.value for setting in session.settings if setting.name == "v_y")
        values = (middle + 0.3 * random.standard_normal(count)).round(3)
        found = np.array([hand.page.evaluate(MOVED, ["v_y", str(value)]) for value in values]) / 1000
        hand.press("play")
        shown = hand.page.evaluate(COUNTED, PLAYED)
        hand.press("pause")
        page.close()
    coarse, refined = np.median(found, axis=0)
    return {
        "changes": count,
        "coarse": round(float(coarse), 3),
        "refined": round(float(refined) - REST, 3),
        "frames_per_second": round(float(shown), 1),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run")
    parser.add_argument("--count", type=int, default=30)
    given = parser.parse_args()
    print(json.dumps(measure(given.run, given.count)))
