"""What every open page of a session shows, and the threads behind it."""

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import Any

import viser

from pacnerf_lpo.errors import Stopped, UserInputError
from pacnerf_lpo.explore.page.ask import Ask
from pacnerf_lpo.explore.page.change import Change
from pacnerf_lpo.explore.page.keep import Keep
from pacnerf_lpo.explore.page.see import See
from pacnerf_lpo.explore.page.stage import Stage
from pacnerf_lpo.explore.page.story import Story
from pacnerf_lpo.explore.page.worker import Worker, guarded
from pacnerf_lpo.explore.records import Camera, Errors, Motion, Step
from pacnerf_lpo.explore.session import Session
from pacnerf_lpo.explore.stepping import ENDING

REST = 0.35
"""Seconds without a movement after which a hand rests: longer than between two events of a slider that is dragged."""
RATE = 24.0
"""Frames shown in a second: eyes see a motion, and a recording of a drop, mostly slower, is in slow motion."""
NOTICE, ERROR = 8.0, 40.0
"""Seconds that a remark and an error stay on the page: long enough to be read twice, and no pile is left."""


@dataclass(frozen=True, eq=False)
class Shown:
    """The step that the pages show, simulated: all that drawing needs, so that it does not wait for a change."""

    step: Step
    errors: Errors | None
    motions: dict[str, Motion]


class Page:
    """A session on a local web page; arguments as of :func:`pacnerf_lpo.explore.page.open_page`.

    Changes are made by one thread, questions are answered by another, so that a hand never waits for an answer. All
    open pages show the same.
    """

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 8080, dark: bool = False):
        self.session = session
        self.recording = session.recordings[0]
        self.camera = self.frame = 0
        self.shown = Shown(session.current, None, {})
        self.playing = threading.Event()
        self._ended = threading.Event()
        self._pen = threading.RLock()
        with redirect_stdout(io.StringIO()):  # the command says where the page is
            self.server = viser.ViserServer(host=host, port=port, verbose=False)
        self.host, self.port = host, self.server.get_port()
        self.dark = dark
        self.colours(dark)
        self.server.gui.set_panel_label(session.name)
        self.changes = Worker(self.complain, self._refine, REST)
        self.questions = Worker(self.complain, lambda: None, REST)
        self.stage = Stage(self.server, lambda number: self.look(camera=number))
        self.see = See(self)
        self.story = Story(self)
        tabs = self.server.gui.add_tab_group()
        self.change = Change(self, tabs)
        self.ask = Ask(self, tabs)
        self.keep = Keep(self, tabs)
        self.server.gui.main_panel.dock_right()
        self.server.gui.main_panel.set_width(380)
        self.choose_recording(self.recording)
        self.changes.ask("redraw", self.redraw, refined_later=True)
        jobs = (("play", self._play), ("prepare", partial(guarded, self._prepare, self.complain)))
        self._threads = [threading.Thread(target=job, name=name, daemon=True) for name, job in jobs]
        for thread in self._threads:
            thread.start()

    def colours(self, dark: bool) -> None:
        """Dark colours, or light ones."""
        self.server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{'localhost' if self.host == '0.0.0.0' else self.host}:{self.port}"

    @property
    def cameras(self) -> list[Camera]:
        """Of the recording that is looked at."""
        return self.session.cameras(self.recording)

    def complain(self, text: str) -> None:
        """Show an error to everyone."""
        self._notify("This did not work", text, ERROR, "red")

    def say(self, title: str, text: str) -> None:
        """Show a remark to everyone."""
        self._notify(title, text, NOTICE, "blue")

    def _notify(self, title: str, text: str, seconds: float, colour: Any) -> None:
        for client in self.server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=seconds, color=colour)

    def by_hand(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """A callback that acts when a person did something, not the program, and explains what goes wrong."""

        def act_on(event: Any) -> None:
            if event.client is not None:
                guarded(partial(act, event), self.complain)

        return act_on

    def make(self, kind: str, job: Callable[[], Any], refined_later: bool = True) -> None:
        """Have the session changed and drawn soon; the newest of a kind only."""

        def made() -> None:
            try:
                job()
            finally:
                self.redraw()

        self.changes.ask(kind, made, refined_later)

    def choose_recording(self, name: str) -> None:
        """Look at another recording."""
        with self.drawing():
            self.recording = name
            self.camera = min(self.camera, max(len(self.cameras) - 1, 0))
            self.see.of_recording()

    def look(self, camera: int | None = None, frame: int | None = None) -> None:
        """Look at another camera or frame."""
        self.camera = self.camera if camera is None else camera
        self.frame = self.frame if frame is None else frame
        with self.drawing():
            self.see.draw()
            self.story.mark()

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """One thread draws at a time, and pages show all of it at once."""
        with self._pen, self.server.atomic():
            yield

    def redraw(self) -> None:
        """Simulate where needed and draw the current step; an unstable one leaves the picture and is reported."""
        session, step = self.session, self.session.current
        if step.trouble is None:
            motions = {name: session.motion(step.number, name) for name in session.recordings}
            self.shown = Shown(session.current, session.error(step.number), motions)
        with self.drawing():
            self.see.take()
            self.story.draw()
            self.change.draw()
            self.ask.draw()
        if step.trouble is not None:
            raise UserInputError(f"{step.name}: the motion is unstable ({step.trouble}); undo, or set another value")

    def _refine(self) -> None:
        step = self.session.refine()
        if step.resolution == "refined" and not self.changes.wanted:
            self.redraw()

    def _prepare(self) -> None:
        """Make the first answers quick, until a question comes; runs in a thread of its own."""
        with suppress(Stopped, UserInputError):  # a person was quicker
            self.session.prepare(stop=self._ended.is_set)

    def _play(self) -> None:
        """Show frame after frame while playing; runs in a thread of its own."""
        due = monotonic()
        while not self._ended.is_set():
            if not self.playing.wait(0.2):
                due = monotonic()
                continue
            guarded(self.see.next_frame, self._stop_playing)
            due = max(due + 1 / RATE, monotonic())
            self._ended.wait(max(due - monotonic(), 0.001))

    def _stop_playing(self, text: str) -> None:
        self.playing.clear()
        self.complain(text)

    def close(self) -> None:
        """Stop what runs, and the server; the session stays."""
        self._ended.set()
        self.playing.clear()
        self.session.stop()
        self.questions.end()
        self.changes.end()
        with redirect_stdout(io.StringIO()):
            self.server.stop()

    def wait(self) -> None:
        """Until nothing computes any more, after :meth:`close`: a thread in native code aborts a program that ends."""
        for thread in (*self._threads, self.questions.thread, self.changes.thread):
            thread.join(timeout=ENDING)
