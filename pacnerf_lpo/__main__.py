"""The command line: ``pacnerf-lpo COMMAND ...``, or ``python -m pacnerf_lpo COMMAND ...``."""

import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NoReturn

from pacnerf_lpo import __version__
from pacnerf_lpo.callbacks.stop_request import INTERRUPTED, end_at_once
from pacnerf_lpo.commands import call
from pacnerf_lpo.errors import Interrupted, RunError, SimulationError, UserInputError
from pacnerf_lpo.heartbeat import doing, heartbeat

# command: (what it does, module with the function run)
COMMANDS = {
    "fit": ("identify geometry and material from a multi-view video", "pacnerf_lpo.commands.fit"),
    "evaluate": ("image metrics and parameter errors of a run", "pacnerf_lpo.commands.evaluate"),
    "render": ("videos of a run: measured, predicted, residual", "pacnerf_lpo.commands.render"),
    "export": ("a run for other programs: ply, vtu, usd, obj, glb, csv, mp4", "pacnerf_lpo.commands.export"),
    "synthesize": ("a multi-view video of a simulated scene", "pacnerf_lpo.commands.synthesize"),
    "benchmark": ("the paper's tables, or quick: runs what is missing", "pacnerf_lpo.commands.benchmark"),
    "diagnose": ("which physical effect the model of a run lacks", "pacnerf_lpo.commands.diagnose"),
    "explore": ("change a model by hand, add effects, watch the error fall", "pacnerf_lpo.commands.explore"),
    "plan": ("which recording to make next after a diagnosis", "pacnerf_lpo.commands.plan"),
    "init": ("a scene from your own recording, in any common layout", "pacnerf_lpo.commands.init"),
    "check": ("whether an effect or a material of your own is right", "pacnerf_lpo.commands.check"),
    "report": ("the page of a run or of a scene, to look at", "pacnerf_lpo.commands.report"),
    "configs": ("configurations that --config knows by name", "pacnerf_lpo.commands.configs"),
}
# their function run reads the command line itself; the arguments of the other commands are those of their run
READING = ("fit", "configs")
LISTED = "\n".join(f"  {name:<12}{what}" for name, (what, _) in COMMANDS.items())
HELP = f"""usage: pacnerf-lpo COMMAND ...

commands:
{LISTED}

example:
  pacnerf-lpo fit --config fit --config demo --outer_loop.run_dir runs/demo

pacnerf-lpo COMMAND --help says more."""


def main(args: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status: 0, 1 run stopped, 2 wrong input, 130 interrupted.

    Materials and effects of the user's own are found in the folder where the command is run.
    """
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    words = list(sys.argv[1:] if args is None else args)
    return guarded(lambda: _dispatch(words))


def guarded(command: Callable[[], int]) -> int:
    """Run a command and turn the errors a user can act on into one line on standard error and an exit status."""
    try:
        return command()
    except UserInputError as error:
        return _complain(error, 2)
    except BrokenPipeError:  # the reader of a pipe, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (RunError, SimulationError, OSError) as error:  # the last: a full disk, a folder that may not be written
        return _complain(error, 1)
    except (Interrupted, KeyboardInterrupt) as error:
        return _complain(error, INTERRUPTED)


def _dispatch(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help"):
        print(HELP)
        return 0 if words else 2
    if words[0] == "--version":
        print(__version__)
        return 0
    if words[0] not in COMMANDS:
        from difflib import get_close_matches

        near = get_close_matches(words[0], COMMANDS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(COMMANDS)}"
        raise UserInputError(f"there is no command {words[0]}; {hint}")
    if words[0] != "configs" and words[1:] in (["-h"], ["--help"]):
        from pacnerf_lpo.commands.help import command_help

        print(command_help(words[0], COMMANDS[words[0]][1]))
        return 0
    with heartbeat("loading the program"):
        module = import_module(COMMANDS[words[0]][1])
        doing(f"at pacnerf-lpo {words[0]}")
        if words[0] not in READING:
            return call(module.run, f"pacnerf-lpo {words[0]}", words[1:])
        return module.run(words[1:])


def _complain(error: BaseException, status: int) -> int:
    print(f"pacnerf-lpo: {' '.join(str(error).split()) or 'interrupted'}", file=sys.stderr)
    return status


def run() -> NoReturn:
    """Run the command of the process's command line, and end the process. No bars are drawn into a log, which would
    hold each of their states; lines say there how far it is. Threads that wait leave their core to others (OpenMP reads
    this when torch is loaded): where they keep it, one other program makes training many times slower.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    if not sys.stderr.isatty():
        os.environ.setdefault("TQDM_DISABLE", "1")
    leave(main())


def leave(status: int) -> NoReturn:
    """End the process with a status; one that was interrupted at once."""
    if status == INTERRUPTED:
        end_at_once()
    sys.exit(status)


if __name__ == "__main__":
    run()
