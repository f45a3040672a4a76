"""Sliders of everything that can be changed, and effects to add or to take out."""

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.page.charts import long, short
from pacnerf_lpo.explore.page.story import element
from pacnerf_lpo.explore.records import Setting
from pacnerf_lpo.quantities import quantity
from pacnerf_lpo.report.wording import capitalised, readable

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

NOTCHES = 300
"""Places of a slider: about its pixels."""


class Change:
    """The tab of settings and effects."""

    def __init__(self, page: "Page", tabs: viser.GuiTabGroupHandle):
        self.page, self.gui = page, page.server.gui
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self._folders: dict[str, viser.GuiFolderHandle] = {}
        self._wanted: dict[str, float] = {}
        with tabs.add_tab("Change", viser.Icon.ADJUSTMENTS):
            self.space = self.gui.add_folder("Model", order=0)
            with self.gui.add_folder("Add an effect", order=1):
                self.effect = self.gui.add_dropdown("effect", ("",))
                self.own = self.gui.add_text("or your own", "", hint="class path, such as lorentz.Lorentz")
                add = self.gui.add_button("Add", icon=viser.Icon.PLUS)
            with self.gui.add_folder("Set exactly", order=2, expand_by_default=False):
                self.exact = self.gui.add_text("name = value", "", hint="in SI units, such as E = 9.5e4")
                enter = self.gui.add_button("Set")
        add.on_click(page.by_hand(lambda _: page.make("add", self._add)))
        enter.on_click(page.by_hand(lambda _: page.make("exact", self._set_exactly)))

    def draw(self) -> None:
        """All values of the current step; sliders come and go with the effects."""
        session = self.page.session
        settings = [setting for setting in session.settings if setting.active]
        self._build(settings)
        for setting in settings:
            if setting.name in self._wanted:  # the hand is further on
                continue
            slider, (low, high, value) = self._sliders[setting.name], _places(setting)
            slider.min, slider.max = min(low, slider.min), max(high, slider.max)
            slider.value = value
            slider.label, slider.hint = short(setting), long(setting)
        view = self.page.cameras[self.page.camera].view if self.page.cameras else None
        free = [info for info in session.effects if not info.active and info.camera in (None, view)]
        self._names = {info.readable: info.name for info in free}
        if tuple(self._names) != self.effect.options:
            self.effect.options = tuple(self._names) or ("",)

    def _build(self, settings: list[Setting]) -> None:
        groups = dict.fromkeys(setting.group for setting in settings)
        for name in self._folders.keys() - groups.keys():
            self._folders.pop(name).remove()
        for group in [name for name in groups if name not in self._folders]:
            own = [setting for setting in settings if setting.group == group]
            with self.space:
                self._folders[group] = self.gui.add_folder(capitalised(readable(group)))
            with self._folders[group]:
                self._sliders |= {setting.name: self._slider(setting) for setting in own}
                if own[0].null is not None:  # of an effect
                    button = self.gui.add_button("Take out", order=99, color="gray")
                    button.on_click(self.page.by_hand(partial(self._remove, group)))

    def _slider(self, setting: Setting) -> viser.GuiSliderHandle[float]:
        low, high, value = _places(setting)
        slider = self.gui.add_slider(short(setting), low, high, (high - low) / NOTCHES, value, marks=_marks(setting))
        slider.precision = max(0, 3 - math.floor(math.log10(max(abs(low), abs(high), 1e-12))))
        if setting.logarithmic:  # its box would show a logarithm; the label shows the value
            self.gui.add_html(f"<style>[id='{element(slider)}'] ~ *{{display:none}}</style>")
        slider.on_update(self.page.by_hand(partial(self._moved, setting)))
        return slider

    def _moved(self, setting: Setting, event: Any) -> None:
        value = float(event.target.value)
        self._wanted[setting.name] = 10.0**value if setting.logarithmic else value
        self.page.make("set", self._set)

    def _set(self) -> None:
        wanted, self._wanted = self._wanted, {}
        if wanted:
            self.page.session.set(wanted, dragging=True)

    def _remove(self, effect: str, _: Any) -> None:
        self.page.make("remove", partial(self.page.session.remove, effect))

    def _add(self) -> None:
        name = self.own.value.strip() or self._names.get(self.effect.value, "")
        if not name:
            raise UserInputError("choose an effect, or type the class path of your own")
        self.page.session.add(name)
        self.own.value = ""

    def _set_exactly(self) -> None:
        name, _, text = self.exact.value.partition("=")
        try:
            value = float(text)
        except ValueError:
            raise UserInputError(f"{self.exact.value}: write it as E = 9.5e4, in SI units") from None
        self.page.session.set(name.strip(), value)


def _places(setting: Setting) -> tuple[float, float, float]:
    """Ends of a slider, and its place."""
    low, high = sorted(_place(setting, end) for end in setting.slider)
    return low, max(high, low + 1e-9), min(max(_place(setting, setting.value), low), high)


def _marks(setting: Setting) -> tuple[tuple[float, str], ...]:
    """The ends of a slider, and the interval of the last fit."""
    low, high = setting.slider
    unit = setting.unit if setting.logarithmic else "1"
    marks = [(value, quantity(value, unit, 2)) for value in setting.slider]
    marks += [(value, text) for value, text in zip(setting.interval or (), "[]", strict=False) if low < value < high]
    return tuple((_place(setting, value), text) for value, text in marks)


def _place(setting: Setting, value: float) -> float:
    """Of a value on a slider: of a setting that spans decades, the logarithm."""
    return float(np.log10(max(value, 1e-300))) if setting.logarithmic else float(value)
