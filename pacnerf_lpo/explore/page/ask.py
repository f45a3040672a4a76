"""Questions: what would help, a fit, a whole diagnosis, and which recording to make next."""

import html
import threading
from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING, Any

import viser

from pacnerf_lpo.errors import Stopped
from pacnerf_lpo.explore.page.charts import STYLE
from pacnerf_lpo.explore.page.words import evidence, reason
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
        self._offered: dict[str, tuple[Suggestion, viser.GuiCheckboxHandle]] = {}
        self._rows: list[Any] = []
        groups = dict.fromkeys(s.group for s in page.session.settings if s.active and s.fitted)
        with tabs.add_tab("Ask", viser.Icon.BULB):
            self.doing = self.gui.add_html("")
            self.halt = self.gui.add_button("Stop", color="red", icon=viser.Icon.PLAYER_STOP, visible=False)
            self.answer = self.gui.add_html("")
            help_ = self.gui.add_button("What would help?", icon=viser.Icon.BULB)
            self.offers = self.gui.add_folder("Suggestions", visible=False)
            with self.gui.add_folder("Fit"):
                self.groups = {
                    group: self.gui.add_checkbox(group, True)
                    for group in groups
                    if group in ("material", "motion", "ground")
                }
                self.added = self.gui.add_checkbox("effects of the model", True)
                fit = self.gui.add_button("Fit", icon=viser.Icon.TARGET)
            diagnose = self.gui.add_button("Diagnose", icon=viser.Icon.STETHOSCOPE, hint="all rounds: minutes")
            plan = self.gui.add_button("Which experiment next?", icon=viser.Icon.FLASK)
        self._buttons = [help_, fit, diagnose, plan]
        for button, job in ((help_, self._suggest), (fit, self._fit), (diagnose, self._diagnose), (plan, self._plan)):
            button.on_click(page.by_hand(self.asker(job)))
        self.halt.on_click(page.by_hand(lambda _: page.session.stop()))

    def asker(self, job: Callable[[], None]) -> Callable[[Any], None]:
        """A callback that has something long done, between a start and an end that one sees."""

        def ask(_: Any) -> None:
            self.page.questions.ask("question", self._answering(job))

        return ask

    def _answering(self, job: Callable[[], None]) -> Callable[[], None]:
        def answer() -> None:
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

        return answer

    def _count(self, ended: threading.Event) -> None:
        """Say what is being done and for how long, until it is done; an animated bar would cost the work a core."""
        began = monotonic()
        while not ended.wait(1.0):
            said = f"{monotonic() - began:.0f} s: {self._task}"
            self.doing.content = f'{STYLE}<div class=hint style="opacity:1">{html.escape(said)}</div>'
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
        for found, tick in self._offered.values():
            tick.value = found.effect in self.page.session.current.effects

    def _suggest(self) -> None:
        found = self.page.session.suggest(MOST, self.tell)
        for row in self._rows:
            row.remove()
        self._offered, self._rows = {}, []
        with self.offers:
            for one in found:
                tick = self.gui.add_checkbox(capitalised(one.readable), False, hint=reason(one))
                tick.on_update(self.page.by_hand(self._ticker(one, tick)))
                self._offered[one.effect] = one, tick
                self._rows += [tick, self.gui.add_html(evidence(one))]
        self.offers.label = f"Suggestions for step {self.page.session.current.number}"
        self.offers.visible = True
        if not found:
            self._report("Nothing of the catalogue would help.")

    def _ticker(self, found: Suggestion, tick: viser.GuiCheckboxHandle) -> Callable[[Any], None]:
        def ticked(_: Any) -> None:
            session, wanted = self.page.session, tick.value

            def change() -> None:
                if wanted and found.effect not in session.current.effects:
                    session.add(found.effect, found.values)
                elif not wanted and found.effect in session.current.effects:
                    session.remove(found.effect)

            self.page.make(f"tick {found.effect}", change)

        return ticked

    def _fit(self) -> None:
        ticked = {group for group, tick in self.groups.items() if tick.value}
        names = [
            setting.name
            for setting in self.page.session.settings
            if setting.active
            and setting.fitted
            and (setting.group in ticked or (setting.group not in self.groups and self.added.value))
        ]
        self.page.session.fit(names, self.tell)

    def _diagnose(self) -> None:
        _, sentences = self.page.session.diagnose(self.tell)
        self._report(*sentences)

    def _plan(self) -> None:
        self._report(*(f"{k + 1}. {one.words}" for k, one in enumerate(self.page.session.plan(self.tell))))

    def _report(self, *sentences: str) -> None:
        said = "<br>".join(html.escape(sentence) for sentence in sentences)
        self.answer.content = f'{STYLE}<div class=hint style="opacity:1">{said}</div>'
