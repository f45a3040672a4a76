"""Keeping: an overlay for fit, the session itself, and a page for others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import viser

from pacnerf_lpo.explore.page.story_page import STORY, write_story

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

OVERLAY = "effects.yaml"


class Keep:
    """The tab of what is saved."""

    def __init__(self, page: Page, tabs: viser.GuiTabGroupHandle):
        self.page, gui = page, page.server.gui
        with tabs.add_tab("Keep", viser.Icon.DEVICE_FLOPPY):
            self.folder = gui.add_text("folder", str(Path(page.session.source.store.folder).parent / "explore"))
            overlay = gui.add_button("Save overlay", icon=viser.Icon.FILE_PLUS, hint=f"{OVERLAY}, for fit --config")
            session = gui.add_button("Save session", icon=viser.Icon.DEVICE_FLOPPY, hint="to open it again")
            story = gui.add_button("Save page", icon=viser.Icon.WORLD, hint="the history, to share, without a server")
            self.dark = gui.add_checkbox("dark", page.dark, hint="colours of all pages")
        for button, save in ((overlay, self._overlay), (session, self._session), (story, self._story)):
            button.on_click(page.by_hand(self._saver(save)))
        self.dark.on_update(page.by_hand(lambda _: page.colours(self.dark.value)))

    def _saver(self, save: Callable[[], None]) -> Callable[[Any], None]:
        return lambda _: self.page.changes.ask(save.__name__, save)

    def _path(self) -> Path:
        path = Path(self.folder.value.strip() or ".")
        path.mkdir(parents=True, exist_ok=True)
        return path

    def _overlay(self) -> None:
        path = self.page.session.save_overlay(self._path() / OVERLAY, recording=self.page.recording)
        self.page.say("Overlay saved", f"{path}; use it by: pacnerf-lpo fit --config RUN/config.yaml --config {path}")

    def _session(self) -> None:
        path = self.page.session.save(self._path())
        self.page.say("Session saved", f"open it again by: pacnerf-lpo explore {path.parent}")

    def _story(self) -> None:
        path = write_story(self.page.session, self._path() / STORY)
        self.page.say("Page saved", f"{path}: one file that opens without a server")
