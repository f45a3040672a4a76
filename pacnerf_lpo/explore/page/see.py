"""The body in space, and a camera's picture of it: which frame, which camera, which colours."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import viser

from pacnerf_lpo.explore import pictures
from pacnerf_lpo.explore.page.charts import chart, path
from pacnerf_lpo.explore.page.stage import KINDS, Moving, centre_and_size
from pacnerf_lpo.explore.records import Motion

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

RADIUS = 0.6
"""Of a particle, of the distance to its neighbours: they touch, and the body is hardly larger than its outline."""
LEAST = 0.012
"""Radius with which a small body that flies far is drawn, relative to its motion: a few pixels."""
PATH = (120, 128, 140)
"""Colour of the places where a rigid body flies."""
SIDE = 230
"""Height of the picture [pixels]."""
WIDTH = 400
"""Of the panel [pixels]."""
GHOST = 0.6
"""Opacity of what was measured where one looks through a camera: the model is seen behind it."""
SLOWER = 5
"""Frames for one change of the words while playing: nobody reads faster, and drawing by software is slow."""
QUALITY = 85
KEPT = 400
"""Pictures that are remembered while a step is shown: all frames of a few cameras."""
APART = 1.6
"""Bodies of several recordings stand apart by so many of the size of their motion."""
PAINTS = {"appearance": "", "speed": "m/s", "stretch": "", "error": "px"}
"""What particles can be coloured by, and its unit."""
SHARE = 99.5
"""Percent of the values that the colours span; a few particles at the rim would spend the scale."""


class See:
    """The left upper panel, and what stands in the scene."""

    def __init__(self, page: "Page"):
        self.page, gui = page, page.server.gui
        self._picture = lru_cache(KEPT)(self._drawn)
        self._size = 0.0
        several = len(page.session.recordings) > 1
        self.panel = gui.add_panel()
        self.panel.dock_left()
        self.panel.set_width(WIDTH)
        with self.panel.add_tab("See", viser.Icon.EYE):
            self.recording = gui.add_dropdown("recording", page.session.recordings, visible=several)
            self.frame = gui.add_slider("frame", 0, 1, 1, 0)
            self.camera = gui.add_slider("camera", 0, 1, 1, 0)
            filmed = any(page.session.cameras(name) for name in page.session.recordings)
            self.buttons = gui.add_button_group("", ("play", "pause", *(("look through",) if filmed else ())))
            self.caption = gui.add_html("")
            self.picture = gui.add_image(np.full((8, 8, 3), 255, np.uint8), jpeg_quality=QUALITY)
            self.path = gui.add_html("", visible=False)
        with self.panel.add_tab("Show", viser.Icon.PALETTE):
            self.paint = gui.add_dropdown("colour", tuple(PAINTS), hint="of the particles")
            self.legend = gui.add_html("")
            hint = "hull of the mattes, tracks and clouds, in space"
            self.measured = gui.add_checkbox("measured", not page.cameras, hint=hint)
            self.close = gui.add_checkbox("close-up", True, hint="the picture follows the body")
            self.dark = gui.add_checkbox("dark", page.dark, hint="colours of all pages")
        self._listen()

    def _listen(self) -> None:
        page = self.page
        choose = lambda: page.choose_recording(self.recording.value)  # noqa: E731
        self.frame.on_update(page.by_hand(lambda _: page.look(frame=int(self.frame.value))))
        self.camera.on_update(page.by_hand(lambda _: page.look(camera=int(self.camera.value))))
        self.recording.on_update(page.by_hand(lambda _: page.make("recording", choose, False)))
        self.paint.on_update(page.by_hand(lambda _: page.changes.ask("paint", self.take)))
        self.measured.on_update(page.by_hand(lambda _: page.changes.ask("measured", self._measure)))
        self.dark.on_update(page.by_hand(lambda _: page.colours(self.dark.value)))
        self.close.on_update(page.by_hand(lambda _: page.look()))
        self.buttons.on_click(page.by_hand(self._pressed))

    def _pressed(self, event: viser.GuiEvent) -> None:
        if self.buttons.value == "play":
            self.page.playing.set()
        elif self.buttons.value == "pause":
            self.page.playing.clear()
            self.frame.value = self.page.frame
            self.page.look()
        elif self.page.cameras:
            self.page.stage.step_into(self.page.camera, event.client)

    def of_recording(self) -> None:
        """Ranges of the sliders, and the cameras, of the recording that is looked at."""
        page, cameras = self.page, self.page.cameras
        last = max(len(page.session.times(name)) for name in page.session.recordings) - 1
        self.frame.max, self.frame.step = max(last, 1), 1
        self.camera.max = max(len(cameras) - 1, 1)
        self.camera.visible = self.picture.visible = bool(cameras)
        self.camera.value = page.camera
        self._picture.cache_clear()
        eyes = np.array([camera.camera_to_world[:3, 3] for camera in cameras]).reshape(-1, 3)
        scale = 0.06 * float(np.linalg.norm(eyes - eyes.mean(0), axis=1).mean() or 1.0) if cameras else 1.0
        page.stage.cameras(cameras, self._offset(page.recording), scale)

    def next_frame(self) -> None:
        """Show the next frame, the first after the last: the body and the picture; words follow more slowly, and the
        charts when playing ends.
        """
        page = self.page
        page.frame = (page.frame + 1) % len(page.session.times(page.recording))
        with page.drawing():
            if page.frame % SLOWER == 0:
                self.frame.value = page.frame
                self.draw()
            else:
                page.stage.show(page.frame)
                if page.cameras and page.shown.motions:
                    self.picture.image = self._picture(page.camera, page.frame, self.close.value)

    def take(self) -> None:
        """Take over the step that is shown: bodies and their colours."""
        with self.page.drawing():
            self._picture.cache_clear()
            motions = self.page.shown.motions
            if not motions:
                return
            if not self._size:
                self._place()
            for name, motion in motions.items():
                colours, frames = self._colours(name, motion), list(motion.positions)
                size = max(RADIUS * motion.size, LEAST * self._size)
                self.page.stage.put(f"body {name}", Moving(frames, colours, size, self._offset(name)))
                self._draw_path(name, motion)
            self.draw()

    def _draw_path(self, name: str, motion: Motion) -> None:
        """Where a rigid body flies, as dots, and where it was measured; a coordinate that was not is the model's."""
        measured = self._centres(name)
        if measured is None:
            return
        model = motion.positions.mean(1)
        tracks = [np.where(np.isfinite(measured), measured, model)] if self.measured.value else []
        self._put("path", name, [model] * len(model), 0.5 * LEAST * self._size)
        self._put("tracks", name, tracks * len(model), 0.5 * LEAST * self._size)

    def _put(self, kind: str, name: str, frames: list[np.ndarray], size: float) -> None:
        """Show points of a kind [m, (N, 3) at every frame] in its colour; nothing where there are none."""
        colour = np.array({"path": PATH, **KINDS}[kind], np.uint8)
        self.page.stage.put(f"{kind} {name}", Moving(frames, colour, size, self._offset(name)))

    def _centres(self, name: str) -> np.ndarray | None:
        """Measured centres of a rigid body in flight [m, (F, 3)]; None where another thing was measured."""
        session = self.page.session
        if session.cameras(name):  # whose hulls would be found for this
            return None
        found = [session.measured(frame, name).centre for frame in range(len(session.times(name)))]
        return None if found[0] is None else np.array(found)

    def draw(self) -> None:
        """The frame and camera that are looked at."""
        page = self.page
        page.stage.show(page.frame)
        cameras, times = page.cameras, page.session.times(page.recording)
        frame = min(page.frame, len(times) - 1)
        held = bool(page.session.held_frames(page.recording)[frame])
        where = f"frame {frame}, {times[frame]:.3f} s"
        if cameras:
            camera = cameras[page.camera]
            where = f"{camera.name}, {where}"
            held = held or camera.held_out
            if page.shown.motions:
                self.picture.image = self._picture(page.camera, frame, self.close.value)
                seen = page.session.outlines(camera.view, frame, page.shown.step.number, page.recording)
                page.stage.mark(page.camera, np.dstack((seen.image, GHOST * seen.measured)))
        centres = self._centres(page.recording) if page.shown.motions else None
        self.path.visible = centres is not None
        if centres is not None:
            model = page.shown.motions[page.recording].positions.mean(1)
            self.path.content = path(times, centres, model, page.session.held_frames(page.recording), frame)
        self.caption.content = chart("caption", where, held, bool(cameras))

    def _drawn(self, camera: int, frame: int, close: bool) -> np.ndarray:
        page, eye = self.page, self.page.cameras[camera]
        seen = page.session.outlines(eye.view, frame, page.shown.step.number, page.recording)
        motion = page.shown.motions[page.recording]
        drawn = pictures.drawing(motion.positions[frame], motion.colours, motion.size, seen.model, eye)
        return pictures.triptych(seen, drawn, SIDE, close)

    def _place(self) -> None:
        centre, size = centre_and_size(self.page.shown.motions)
        grounds = (setting.value for setting in self.page.session.settings if setting.group == "ground")
        floor = next(grounds, float(centre[1] - size / 2))
        count = len(self.page.session.recordings)
        self.page.stage.ground(floor, centre, size * count)
        self.page.stage.look(centre + np.array([APART * size * (count - 1) / 2, 0, 0]), 0.55 * size * (1 + count))
        self._size = size
        if self.measured.value:
            self.page.changes.ask("measured", self._measure)
        errors = self.page.shown.errors
        if errors is not None and np.isfinite(errors.by_frame_fitted).any():
            self.page.frame = int(np.nanargmax(errors.by_frame_fitted))
            self.frame.value = self.page.frame
        self.of_recording()

    def _offset(self, name: str) -> np.ndarray:
        number = self.page.session.recordings.index(name)
        return np.array([APART * self._size * number, 0.0, 0.0])

    def _colours(self, name: str, motion: Motion) -> np.ndarray:
        """Of particles [0..255, (N, 3) or (F, N, 3), uint8], and their legend."""
        session, step, kind = self.page.session, self.page.shown.step, self.paint.value
        if kind == "appearance":
            self.legend.content = ""
            return np.rint(255 * np.clip(motion.colours, 0, 1)).astype(np.uint8)
        least = 1.0 if kind == "stretch" else 0.0
        look = {"stretch": session.stretch, "error": session.particle_errors}.get(kind)
        values = motion.speed if look is None else look(step.number, name) - least
        known = values[np.isfinite(values)]
        most = float(np.percentile(known, SHARE)) if len(known) else 1.0
        stops = ["#" + bytes(colour).hex() for colour in pictures.painted(np.linspace(0.0, 1.0, 9), 1.0)]
        self.legend.content = chart("colours", least, least + most, PAINTS[kind], stops)
        return pictures.painted(values, most)

    def _measure(self) -> None:
        """Show or hide what was measured in space; the hulls of all frames are found once, some seconds."""
        page = self.page
        for name in page.session.recordings:
            if name in page.shown.motions and self._centres(name) is not None:
                with page.drawing():
                    self._draw_path(name, page.shown.motions[name])
                continue
            shown = range(len(page.session.times(name))) if self.measured.value else ()
            found = [page.session.measured(frame, name) for frame in shown]
            size = max((one.cell for one in found), default=0.0) or 0.03 * self._size
            for kind in KINDS:
                frames = [{"hull": one.hull, "tracks": one.tracks, "clouds": one.cloud}[kind] for one in found]
                with page.drawing():
                    self._put(kind, name, frames, 0.45 * size)
