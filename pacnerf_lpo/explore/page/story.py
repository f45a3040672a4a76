"""The history of steps and where the current one fails: by camera and frame, over time, by side of the body."""

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import viser

from pacnerf_lpo.explore.page import charts

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page


class Story:
    """The left lower panel."""

    def __init__(self, page: "Page"):
        self.page, gui = page, page.server.gui
        self._regions = lru_cache(1)(lambda shown, recording: page.session.regions(shown.step.number, recording))
        panel = gui.add_panel()
        panel.dock_below(page.see.panel)
        with panel.add_tab("Steps", viser.Icon.STAIRS_DOWN):
            self.steps = gui.add_html("")
            self.step = gui.add_slider("step", 0, 1, 1, 0, hint="go to any step of the history")
            self.buttons = gui.add_button_group("", ("undo", "redo", "compare"))
            self.against = gui.add_slider("compare with", 0, 1, 1, 0)
            self.compared = gui.add_html("")
        with panel.add_tab("Camera, frame", viser.Icon.GRID_DOTS):
            self.map = gui.add_html("")
        with panel.add_tab("Time and body", viser.Icon.CHART_LINE):
            self.time = gui.add_html("")
            self.body = gui.add_html("")
        self.step.on_update(page.by_hand(lambda _: page.make("go", lambda: page.session.go_to(int(self.step.value)))))
        self.buttons.on_click(page.by_hand(self._pressed))

    def _pressed(self, event: Any) -> None:
        pressed, session = self.buttons.value, self.page.session
        if pressed == "compare":
            self.compared.content = charts.difference_table(session, int(self.against.value), session.current.number)
        else:
            self.page.make(pressed, session.undo if pressed == "undo" else session.redo)

    def draw(self) -> None:
        """The history, and the errors of the step that is shown."""
        session, current = self.page.session, self.page.session.current
        for slider in (self.step, self.against):
            slider.max = max(len(session.steps) - 1, 1)
        self.step.value = current.number
        self.steps.content = charts.history(session.steps, current.number, session.unit, element(self.step))
        self.mark()

    def mark(self) -> None:
        """The errors with the camera and frame that are looked at."""
        page, errors = self.page, self.page.shown.errors
        if errors is None:
            return
        shown = errors.of(page.recording)
        selected = page.camera, min(page.frame, shown.table.shape[1] - 1)
        sliders = element(page.see.camera), element(page.see.frame)
        self.map.content = charts.heat_map(shown, selected, sliders)
        self.time.content = charts.over_time(errors, selected[1])
        if page.cameras:
            areas = self._regions(page.shown, page.recording)
            self.body.content = charts.by_name({side: float(area[selected[1]]) for side, area in areas.items()}, "px²")


def element(handle: Any) -> str:
    """Identifier of a slider's element in the page, which viser gives it but does not publish."""
    return handle._impl.uuid
