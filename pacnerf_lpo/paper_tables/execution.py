"""One run in a process of its own. Imports little, because joblib's workers import it."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil

FIT = (sys.executable, "-m", "pacnerf_lpo", "fit")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PACNERF_LPO_THREADS")
POLL_SECONDS = 0.5
Status = Literal["finished", "failed", "stopped"]
LOG_FILE = "log.txt"
FAILURE_FILE = "failure.txt"


@dataclass(frozen=True)
class Task:
    """What a worker needs to go on with a run in a prepared directory: the command of ``fit``, its CPU threads, a limit
    of its resident memory [bytes] or None, and a file: while it exists, runs are stopped and none is started.
    """

    run_dir: Path
    command: tuple[str, ...]
    threads: int
    memory: int | None
    stop: Path


@dataclass(frozen=True)
class Outcome:
    """How it ended: ``finished``, ``failed`` (with one line why) or ``stopped``."""

    run_dir: Path
    status: Status
    error: str = ""


def execute(task: Task) -> Outcome:
    """Run ``fit --resume`` to its end, its failure or the stop file; why it failed is kept next to the run."""
    if threading.current_thread() is threading.main_thread() and os.environ.get("LOKY_WORKER"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the stop file first
    if task.stop.exists():
        return Outcome(task.run_dir, "stopped")
    with _locked(task.run_dir) as lock:
        outcome = _run(task, lock) if lock is not None else Outcome(task.run_dir, "failed", "another process runs it")
    failure = task.run_dir / FAILURE_FILE
    if outcome.status == "failed":
        failure.write_text(outcome.error)
    else:
        failure.unlink(missing_ok=True)
    return outcome


def _run(task: Task, lock: int) -> Outcome:
    environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, str(task.threads))}
    command = [*task.command, "--resume", str(task.run_dir)]
    with open(task.run_dir / LOG_FILE, "ab") as log:
        begin = log.tell()
        child = subprocess.Popen(  # a session of its own: Ctrl-C goes to the benchmark alone
            command, stdout=log, stderr=log, stdin=subprocess.DEVNULL, env=environment, start_new_session=True,
            pass_fds=(lock,),
        )  # fmt: skip
        try:
            reason = _watch(child, task)
        finally:
            if child.poll() is None:
                child.kill()
                child.wait()
    if child.returncode == 0:
        return Outcome(task.run_dir, "finished")
    if reason == "stopped":
        return Outcome(task.run_dir, "stopped")
    return Outcome(task.run_dir, "failed", reason or _last_line(task.run_dir / LOG_FILE, begin, child.returncode))


def _watch(child: subprocess.Popen, task: Task) -> str:
    """Wait for the end of the run; returns why it was ended from here, or nothing."""
    reason = ""
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(POLL_SECONDS)
            return reason
        if not reason and task.stop.exists():
            reason = "stopped"
        elif not reason and task.memory is not None and (used := _memory(child.pid)) > task.memory:
            reason = f"memory: {used / 2**30:.1f} GiB used, the limit is {task.memory / 2**30:.1f} GiB"
        else:
            continue
        child.send_signal(signal.SIGTERM)  # fit finishes its optimiser step and writes a checkpoint


def _memory(pid: int) -> int:
    """Resident memory of a process and its children [bytes]."""
    try:
        process = psutil.Process(pid)
        return sum(one.memory_info().rss for one in (process, *process.children(recursive=True)))
    except psutil.NoSuchProcess:
        return 0


def _last_line(log: Path, begin: int, status: int) -> str:
    """The last line the run printed, without the name of the program."""
    lines = log.read_bytes()[begin:].decode(errors="replace").strip().splitlines()
    said = lines[-1].strip().removeprefix("pacnerf-lpo: ") if lines else "no output"
    return f"{said} (exit status {status})" if status < 0 else said


@contextlib.contextmanager
def _locked(run_dir: Path) -> Iterator[int | None]:
    """A lock that the run inherits: it is held until both have ended. None where another process holds it."""
    with open(run_dir / ".lock", "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
            return
        yield file.fileno()
