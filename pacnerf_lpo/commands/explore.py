"""``pacnerf-lpo explore``: a page on which a model, its measurement and their error are side by side."""

from __future__ import annotations

import os
import signal
import socket
import threading
import webbrowser

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore import Session
from pacnerf_lpo.heartbeat import doing


def run(
    run_dirs: list[str] | str,
    host: str = "127.0.0.1",
    port: int = 8080,
    phase: str | None = None,
    candidates: str | None = None,
    jobs: int | None = None,
    dark: bool = False,
    browser: bool = False,
) -> None:
    """Change a model by hand and watch the error fall: a local page with the body in 3-D, the video and the error.

    Every change is simulated at once. The page offers all effects of the catalogue, says which would help, fits what
    is ticked, and saves an overlay that fit takes. Ctrl-C ends it.

    example: pacnerf-lpo explore runs/demo_missing

    Args:
        run_dirs: folder that fit wrote, its scene, the folder of a study, several runs or scenes of one object, scenes
            of measured flights, or a saved session.
        host: address to listen on; 0.0.0.0 lets other machines in, without a password.
        port: to listen on; the next free one where it is taken.
        phase: stem of a finished phase, such as 01_velocity; the last one before a correction when not given.
        candidates: YAML list of effects of your own, in addition to the catalogue: a file, or a name.
        jobs: processes of suggestions and fits, as for diagnose.
        dark: dark colours.
        browser: open the page in a browser, too.
    """
    check_address(host, port)
    Page = page_class()
    doing("reading the run")
    given = [run_dirs] if isinstance(run_dirs, str) else run_dirs
    with Session.open(given, phase, candidates, jobs=jobs) as session:
        page = Page(session, host, port, dark)
        told = "" if page.port == port else f" (port {port} is taken)"
        print(f"explore: {page.url}{told}; Ctrl-C ends it", flush=True)
        if browser:
            webbrowser.open(page.url)
        try:
            wait_for_signal()
        finally:
            page.close()
    print("explore: ended", flush=True)


def page_class() -> type:
    """The page, whose viewer is an optional dependency. Raises UserInputError where it is missing."""
    try:
        from pacnerf_lpo.explore.page.page import Page
    except ModuleNotFoundError as error:
        if error.name != "viser":
            raise
        raise UserInputError("explore needs the viewer viser: pip install 'pacnerf-lpo[explore]'") from error
    return Page


def check_address(host: str, port: int) -> None:
    """Raise UserInputError where nothing can listen at an address."""
    if not 0 <= port < 65536:
        raise UserInputError(f"--port {port}: give a number from 0 (any free one) to 65535")
    if 0 < port < 1024 and os.geteuid() != 0:
        raise UserInputError(f"--port {port}: ports below 1024 belong to the system; give a larger one")
    try:
        with socket.socket() as trial:
            trial.bind((host, 0))
    except OSError as error:
        raise UserInputError(f"--host {host}: {error}; give an address of this machine, such as 127.0.0.1") from error


def wait_for_signal() -> None:
    """Return at SIGINT or SIGTERM."""
    asked = threading.Event()
    previous = {number: signal.signal(number, lambda *_: asked.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        doing(None)
        asked.wait()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
