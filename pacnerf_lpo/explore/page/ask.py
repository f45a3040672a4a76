"""Questions: what would help, a fit, a whole diagnosis, and which recording to make next."""

import threading
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import TYPE_CHECKING, Any

import viser
from markupsafe import Markup

from pacnerf_lpo.errors import Stopped
from pacnerf_lpo.explore.page.charts import evidence, hint, reason
from pacnerf_lpo.explore.records import Suggestion
from pacnerf_lpo.report.wording import capitalised

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

MOST = 6
"""Suggestions that are shown: what comes after hardly ever is the cause, and a list has to fit the page."""


class Ask:
    """The tab of questions."""

    def __init__(self, page: "Page", tabs: viser.GuiTabGroupHandle):
        self.page, self.gui = page, page.server.gui
        self._offered: list[tuple[Suggestion, viser.GuiCheckboxHandle, viser.GuiHtmlHandle]] = []
        groups = dict.fromkeys(s.group for s in page.session.settings if s.fitted and s.null is None)
        with tabs.add_tab("Ask", viser.Icon.BULB):
            self.doing = self.gui.add_html("")
            self.halt = self.gui.add_button("Stop", color="red", icon=viser.Icon.PLAYER_STOP, visible=False)
            self.answer = self.gui.add_html("")
            help_ = self.gui.add_button("What would help?", icon=viser.Icon.BULB)
            self.offers = self.gui.add_folder("Suggestions", visible=False)
            with self.gui.add_folder("Fit"):
                self.groups = {group: self.gui.add_checkbox(group, True) for group in groups}
                self.added = self.gui.add_checkbox("effects of the model", True)
                fit = self.gui.add_button("Fit", icon=viser.Icon.TARGET)
            diagnose = self.gui.add_button("Diagnose", icon=viser.Icon.STETHOSCOPE, hint="all rounds: minutes")
            plan = self.gui.add_button("Which experiment next?", icon=viser.Icon.FLASK)
        self._buttons = [help_, fit, diagnose, plan]
        for button, job in ((help_, self._suggest), (fit, self._fit), (diagnose, self._diagnose), (plan, self._plan)):
            button.on_click(page.by_hand(partial(self.ask, job)))
        self.halt.on_click(page.by_hand(lambda _: page.session.stop()))

    def ask(self, job: Callable[[], None], _: Any) -> None:
        """Have something long done, between a start and an end that one sees."""
        self.page.questions.ask("question", partial(self._answer, job))

    def _answer(self, job: Callable[[], None]) -> None:
        ended = threading.Event()
        self._task = "beginning"
        threading.Thread(target=self._count, args=(ended,), name="seconds", daemon=True).start()
        self._busy(True)
        try:
            job()
        except Stopped:
            self.page.say("Stopped", "What was found until then is kept.")
        finally:
            ended.set()
            self._busy(False)
            self.page.changes.ask("redraw", self.page.redraw, refined_later=True)

    def _count(self, ended: threading.Event) -> None:
        """Say what is being done and for how long, until it is done; an animated bar would cost the work a core."""
        began = monotonic()
        while not ended.wait(1.0):
            self.doing.content = hint(f"{monotonic() - began:.0f} s: {self._task}", "opacity:1")
        self.doing.content = ""

    def _busy(self, busy: bool) -> None:
        for button in self._buttons:
            button.disabled = busy
        self.halt.visible = busy

    def tell(self, text: str) -> None:
        """Say what is being done."""
        self._task = text

    def draw(self) -> None:
        """Ticks follow the model."""
        for found, tick, _ in self._offered:
            tick.value = found.effect in self.page.session.current.effects

    def _suggest(self) -> None:
        found = self.page.session.suggest(MOST, self.tell)
        for _, *row in self._offered:
            for handle in row:
                handle.remove()
        self._offered = []
        with self.offers:
            for one in found:
                tick = self.gui.add_checkbox(capitalised(one.readable), False, hint=reason(one))
                tick.on_update(self.page.by_hand(partial(self._ticked, one)))
                self._offered.append((one, tick, self.gui.add_html(evidence(one))))
        self.offers.label = f"Suggestions for step {self.page.session.current.number}"
        self.offers.visible = True
        if not found:
            self._report("Nothing of the catalogue would help.")

    def _ticked(self, found: Suggestion, event: viser.GuiEvent) -> None:
        self.page.make(f"tick {found.effect}", partial(self._change, found, event.target.value))

    def _change(self, found: Suggestion, wanted: bool) -> None:
        session = self.page.session
        if wanted and found.effect not in session.current.effects:
            session.add(found.effect, found.values)
        elif not wanted and found.effect in session.current.effects:
            session.remove(found.effect)

    def _fit(self) -> None:
        ticked = {group for group, tick in self.groups.items() if tick.value}
        effects = self.added.value
        free = [setting for setting in self.page.session.settings if setting.active and setting.fitted]
        chosen = [one for one in free if one.group in ticked or (effects and one.group not in self.groups)]
        self.page.session.fit([setting.name for setting in chosen], self.tell)

    def _diagnose(self) -> None:
        _, sentences = self.page.session.diagnose(self.tell)
        self._report(*sentences)

    def _plan(self) -> None:
        self._report(*(f"{k + 1}. {one.words}" for k, one in enumerate(self.page.session.plan(self.tell))))

    def _report(self, *sentences: str) -> None:
        self.answer.content = hint(Markup("<br>").join(sentences), "opacity:1")
