"""From a recording to a scene in PAC-NeRF's layout, with what its outlines say."""

import json
import logging
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from pacnerf_lpo.data.index import NAME, check_unused, entry_of
from pacnerf_lpo.data.recordings.agreement import check_different, check_in_front
from pacnerf_lpo.data.recordings.findings import Findings, investigate
from pacnerf_lpo.data.recordings.mattes import Mattes
from pacnerf_lpo.data.recordings.recording import AXES, UNITS, Recording, check_recording
from pacnerf_lpo.data.recordings.refinement import refined
from pacnerf_lpo.data.recordings.shots import LEAST_OBJECT, Shots, image_at, look, no_object, save, synchronised
from pacnerf_lpo.data.recordings.timeline import Timeline, common_times, stated_times
from pacnerf_lpo.errors import Unmeasured, UserInputError

log = logging.getLogger(__name__)

DOUBTFUL = 0.9
"""Expected overlap below which a matte is reported as doubtful: of a body of forty pixels, its rim of one pixel."""
T = TypeVar("T")


@dataclass(frozen=True)
class Scene:
    """A written scene.

    folder: where it is. recording: as used. times: [s, (F,)]. findings: what was measured.
    mattes: how each camera was matted
    overlaps: intersection over union that each camera's mattes are expected to have with the truth, 1 for given ones
    offsets: how much later than these times each camera's frames were taken [s, (V,)]
    clocks: the same in words
    mended: repeated, missing, filled-in and cut-off frames, a line each
    """

    folder: Path
    recording: Recording
    times: np.ndarray
    findings: Findings
    mattes: tuple[str, ...]
    overlaps: tuple[float, ...]
    offsets: np.ndarray
    clocks: str
    mended: tuple[str, ...]


def convert(recording: Recording, folder: Path) -> Scene:
    """Write ``folder/all_data.json`` and ``folder/data``: undistorted, matted, in metres, y up, the ground at y = 0.

    Images smaller than the largest are extended to the right and below; what no camera pixel shows is marked by an
    occluder (frame -2). Backgrounds, given or found, are frame -1. Where something is wrong, no scene is left, but the
    mattes made so far, in a folder beside it that the message names. Raises UserInputError where something in the
    recording is wrong or missing, or ``folder`` is in use.
    """
    check_unused(folder)
    check_recording(recording)
    recording, stamps = asked(recording, stated_times)
    names = [camera.name for camera in recording.cameras]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-")
    except OSError as error:
        raise UserInputError(f"{folder}: cannot be written ({error.strerror}); give another place") from None
    with beside as work:
        images = Path(work, "data")
        images.mkdir()
        with _kept_to_look_at(images, names, folder):
            mattes = [Mattes(camera) for camera in recording.cameras]
            size = max(m.size[0] for m in mattes), max(m.size[1] for m in mattes)
            shots = [look(images, view, *pair, size) for view, pair in enumerate(zip(mattes, stamps, strict=True))]
            if all(m.plate is not None for m in mattes):  # drawn on nothing, a symmetric body may look the same twice
                check_different([shot.images for shot in shots], recording)
            check_in_front([shot.sighting for shot in shots], recording)
            shots, clocks = refined(images, mattes, stamps, size, *synchronised(shots))
            corrected = [shot.sighting.times + offset for shot, offset in zip(shots, clocks.offsets, strict=True)]
            timeline = common_times(recording, corrected)
            for view, matted in enumerate(mattes):
                _write_camera(images, view, matted, size, shots[view], timeline.places[view])
            now = timeline.start + timeline.times
            views = [shot.planes(offset, now) for shot, offset in zip(shots, clocks.offsets, strict=True)]
            recording, found = asked(recording, lambda known: investigate(views, timeline.times, known))
        Path(work, NAME).write_text(json.dumps(list(_entries(recording, timeline, found))))
        folder.mkdir(exist_ok=True)
        for name in ("data", NAME):
            shutil.move(Path(work, name), folder / name)
    mended = tuple(_mended(names, shots, timeline))
    ways, overlaps = tuple(m.described for m in mattes), tuple(float(m.overlaps.mean()) for m in mattes)
    for name, overlap in zip(names, overlaps, strict=True):
        if overlap < DOUBTFUL:
            log.warning(
                f"camera {name}: object and background are hard to tell apart (expected overlap with the truth "
                f"{overlap:.2f}); give masks, or an image of the empty background as backgrounds/{name}.png"
            )
    return Scene(folder, recording, timeline.times, found, ways, overlaps, timeline.offsets, clocks.said(names), mended)


def _mattes_beside(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}_mattes")


def forget_mattes(folder: Path) -> None:
    """Remove the mattes that an earlier, refused attempt left beside the folder of a scene."""
    beside = _mattes_beside(folder)
    for old in beside.glob("*_[0-9][0-9][0-9][0-9].png"):
        old.unlink()
    if beside.is_dir() and not any(beside.iterdir()):
        beside.rmdir()


@contextmanager
def _kept_to_look_at(images: Path, names: Sequence[str], folder: Path) -> Iterator[None]:
    """Where the recording is refused, keep its mattes beside the folder of the scene, and say where."""
    try:
        yield
    except UserInputError as error:
        beside, made = _mattes_beside(folder), [*images.glob("own_*.png"), *images.glob("m_*.png")]
        if not made:
            raise
        beside.mkdir(exist_ok=True)
        for path in made:
            _, view, frame = path.stem.split("_")
            shutil.move(path, beside / f"{names[int(view)]}_{int(frame):04}.png")
        raise UserInputError(f"{error}; {beside} has its mattes, to look at") from None


def _write_camera(
    images: Path, view: int, mattes: Mattes, size: tuple[int, int], shots: Shots, places: np.ndarray
) -> None:
    """Write what one camera shows at the common times: images, background and occluder."""
    if shots.areas[round(places[0])] < LEAST_OBJECT:
        raise no_object(mattes, int(shots.frames[round(places[0])]))
    for frame, place in enumerate(places):
        save(images / f"m_{view}_{frame}.png", image_at(shots, place), size)
    for own in images.glob(f"own_{view}_*.png"):
        own.unlink()
    if mattes.plate is not None:
        save(images / f"r_{view}_-1.png", np.dstack((mattes.plate, np.ones(mattes.plate.shape[:2]))), size)
    valid = np.zeros(size[::-1], bool)
    valid[: mattes.size[1], : mattes.size[0]] = mattes.lens.valid
    if not valid.all():
        save(images / f"r_{view}_-2.png", np.dstack((np.zeros((*valid.shape, 3)), ~valid)), size)


def _mended(names: Sequence[str], shots: Sequence[Shots], timeline: Timeline) -> Iterator[str]:
    for name, shot, places in zip(names, shots, timeline.places, strict=True):
        if shot.said:
            yield f"camera {name}: {'; '.join(shot.said)}"
        filled = np.flatnonzero(places != np.round(places))
        if len(filled):
            yield f"camera {name}: filled in between two images: frames {frame_ranges(filled)}"
        if len(shot.cut_off):
            yield (
                f"camera {name}: the image cuts the object off in its frames {frame_ranges(shot.cut_off)}; "
                "what is cut off there says nothing about box, ground and contact"
            )


def frame_ranges(numbers: Sequence[int] | np.ndarray) -> str:
    """3-5, 8 for 3, 4, 5, 8."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _entries(recording: Recording, timeline: Timeline, found: Findings) -> Iterator[dict]:
    for view, camera in enumerate(recording.cameras):
        pose = found.rotation @ camera.pose
        pose[:, 3] = found.scale * pose[:, 3] - [0.0, found.ground.value, 0.0]
        for frame, time in enumerate(timeline.times):
            entry = entry_of(view, frame, time, pose, camera.intrinsic)
            yield {**entry, "time_offset": float(timeline.offsets[view])}


def asked(recording: Recording, work: Callable[[Recording], T]) -> tuple[Recording, T]:
    """Do ``work``, and ask at a terminal for a value that it lacks. Raises UserInputError where nobody answers."""
    while True:
        try:
            return recording, work(recording)
        except Unmeasured as gap:
            if not (sys.stdin.isatty() and sys.stderr.isatty()):
                raise
            recording = _ask(recording, gap)


def _ask(recording: Recording, gap: Unmeasured) -> Recording:
    above = np.sum([camera.pose[:, 1] for camera in recording.cameras], axis=0)  # what all of them have on top
    words, default, answered = {
        "up": (
            f"Which axis of the calibration points up: {', '.join(AXES)}?",
            max(AXES, key=lambda name: float(np.dot(AXES[name], above))),
            recording.with_up,
        ),
        "unit": (
            f"Which unit has the calibration: {', '.join(UNITS)}, or how many metres is one unit?",
            "m",
            recording.with_unit,
        ),
        "fps": ("How many frames per second have the videos?", "30", lambda fps: recording.with_frame_rate(float(fps))),
    }[gap.option]
    print(f"{gap}", file=sys.stderr)
    while True:
        print(f"{words} [{default}]: ", end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline()
        if not answer:
            raise gap
        try:
            return answered(answer.strip() or default)
        except (UserInputError, ValueError):
            print(f"'{answer.strip()}' is no answer to that", file=sys.stderr)
