"""Keeping: an overlay for fit, the session itself, and a page for others."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import viser
from markupsafe import Markup

from pacnerf_lpo.explore.page.charts import hint
from pacnerf_lpo.explore.page.story_page import STORY, write_story

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

OVERLAY = "effects.yaml"


class Keep:
    """The tab of what is saved."""

    def __init__(self, page: "Page", tabs: viser.GuiTabGroupHandle):
        self.page, gui = page, page.server.gui
        with tabs.add_tab("Keep", viser.Icon.DEVICE_FLOPPY):
            self.folder = gui.add_text("folder", str(page.session.folder))
            overlay = gui.add_button("Save overlay", icon=viser.Icon.FILE_PLUS, hint=f"{OVERLAY}, for fit --config")
            session = gui.add_button("Save session", icon=viser.Icon.DEVICE_FLOPPY, hint="to open it again")
            story = gui.add_button("Save page", icon=viser.Icon.WORLD, hint="the history, to share, without a server")
            self.saved = gui.add_html("")
            report = gui.add_button("Save report", icon=viser.Icon.REPORT, hint="this step and the first one")
        report.on_click(page.by_hand(partial(page.ask.ask, self._report)))
        for button, save in ((overlay, self._overlay), (session, self._session), (story, self._story)):
            button.on_click(page.by_hand(partial(self._ask, save)))

    def _ask(self, save: Callable[[], None], _: Any) -> None:
        self.page.changes.ask(save.__name__, save)

    def _path(self) -> Path:
        return Path(self.folder.value.strip() or ".")

    def _overlay(self) -> None:
        path = self.page.session.save_overlay(self._path() / OVERLAY, recording=self.page.recording)
        self._tell("Overlay saved", path, f"pacnerf-lpo fit --config RUN/config.yaml --config {path}")

    def _session(self) -> None:
        path = self.page.session.save(self._path())
        self._tell("Session saved", path, f"pacnerf-lpo explore {path.parent}")

    def _story(self) -> None:
        path = write_story(self.page.session, self._path() / STORY)
        self._tell("Page saved", path, "one file, opens without a server")

    def _report(self) -> None:
        path = self.page.session.report(self._path(), progress=self.page.ask.tell)
        self._tell("Report saved", path, "open it in a browser")

    def _tell(self, title: str, path: Path, use: str) -> None:
        self.page.say(title, path.name)
        text = Markup("<b>{}</b>: {}<br>{}").format(title, path, use)
        self.saved.content = hint(text, "opacity:1;overflow-wrap:anywhere")
