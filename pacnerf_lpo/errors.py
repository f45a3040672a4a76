"""Errors a user can act on: each message says what is wrong, where, and how to mend it."""


class UserInputError(ValueError):
    """Something the user gave (a file, a folder, a config value) cannot be used.

    The command line prints the message on one line, without a traceback, and exits with status 2.
    """


class Unmeasured(UserInputError):
    """A value that a recording neither says nor shows; ``option`` is the one of ``init`` that gives it."""

    def __init__(self, message: str, option: str):
        super().__init__(message)
        self.option = option


class SimulationError(RuntimeError):
    """A rollout left the range in which the discretisation is valid (NaN, CFL, particle outside the grid).

    Attributes:
        frame: index of the video frame interval in which it happened.
        substep: index of the substep within that interval.
        cause: one clause, such as ``"|v| dt > dx (v = 310 m/s)"``.
    """

    def __init__(self, frame: int, substep: int, cause: str):
        super().__init__(f"simulation stopped in frame {frame}, substep {substep}: {cause}")
        self.frame, self.substep, self.cause = frame, substep, cause

    def __reduce__(self) -> tuple[type["SimulationError"], tuple[int, int, str]]:
        """It may happen in another process."""
        return type(self), (self.frame, self.substep, self.cause)


class RunError(RuntimeError):
    """A run stopped for a reason the message explains; what was computed before is kept.

    The command line prints the message on one line and exits with status 1.
    """


class Interrupted(BaseException):
    """The user (SIGINT) or the system (SIGTERM) asked the run to stop; the command line exits with status 130."""


class Stopped(Exception):
    """Whoever asked for a result does not want it any more; nothing is wrong, and what was computed before is kept."""
