"""The page of a session: what a person sees and touches. Its viewer is the optional dependency ``explore``."""

import socket
from typing import TYPE_CHECKING

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.session import Session

if TYPE_CHECKING:
    from pacnerf_lpo.explore.page.page import Page

LOCAL = "127.0.0.1"
"""Where a page listens where nothing else is given: it has no password."""
PORT = 8080


def open_page(session: Session, host: str = LOCAL, port: int = PORT, dark: bool = False) -> "Page":
    """The page of a session, served until it is closed, in ``dark`` colours or in light ones.

    Args:
        host: address to listen on.
        port: to listen on, 0 for any; the next free one where it is taken.

    Raises:
        UserInputError: nothing can listen there, or the viewer is not installed.
    """
    if not 0 <= port < 65536:
        raise UserInputError(f"--port {port}: give a number from 0 (any free one) to 65535")
    for at in (0, port) if port < 1024 else (0,):  # a larger one that is taken is replaced by the next
        try:
            with socket.socket() as trial:
                trial.bind((host, at))
        except OSError as error:
            where = f"--port {port}" if at else f"--host {host}"
            raise UserInputError(f"{where}: {error}; give an address of this machine and a port above 1023") from error
    try:
        from pacnerf_lpo.explore.page.page import Page
    except ModuleNotFoundError as error:
        if error.name != "viser":
            raise
        raise UserInputError("explore needs a viewer: pip install 'pacnerf-lpo[explore]'") from error
    return Page(session, host, port, dark)


def show(session: Session, height: int = 800, dark: bool = False) -> "Page":
    """The page inside a notebook's cell of so much ``height`` [pixels]; close it with ``close()``. Raises
    UserInputError as :func:`open_page`, or where there is no notebook.
    """
    try:
        from IPython.display import IFrame, display
    except ModuleNotFoundError as error:
        raise UserInputError("explore: show() is for a notebook; elsewhere use open_page()") from error
    page = open_page(session, port=0, dark=dark)
    display(IFrame(page.url, width="100%", height=height))
    return page
