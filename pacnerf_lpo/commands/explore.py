"""``pacnerf-lpo explore``: a page on which a model, its measurement and their error are side by side."""

import threading
import webbrowser
from contextlib import suppress

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.errors import Interrupted
from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import LOCAL, PORT, open_page
from pacnerf_lpo.heartbeat import doing

LAST = "last"
"""Folder of the session that ended last: nothing that was tried is lost, and nothing that was saved is overwritten."""


def run(
    run_dirs: list[str] | str,
    host: str = LOCAL,
    port: int = PORT,
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
    doing("reading the run")
    given = [run_dirs] if isinstance(run_dirs, str) else run_dirs
    with Session.open(given, phase, candidates, jobs=jobs) as session:
        begun = len(session.steps)
        page = open_page(session, host, port, dark)
        remark = "" if port in (0, page.port) else f" (port {port} is taken)"
        print(f"explore: {page.url}{remark}; Ctrl-C ends it", flush=True)
        if browser:
            webbrowser.open(page.url)
        try:
            wait_for_signal()
        finally:
            page.close()
        if len(session.steps) > begun:
            kept = session.save(session.folder / LAST).parent
            print(f"explore: all steps are kept; go on by pacnerf-lpo explore {kept}")
        page.wait()
    print("explore: ended", flush=True)


def wait_for_signal() -> None:
    """Return at SIGINT or SIGTERM."""
    with suppress(Interrupted), StopRequest():
        doing(None)
        threading.Event().wait()
