"""Inconsistencies of a scene's files and of the data section, found before training starts.

Every function raises UserInputError, one line: what is wrong, in which file or config key, and how to mend it.
"""

import logging
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.cameras import hits_box, pixel_rays
from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.index import Index, Shot
from pacnerf_lpo.data.measurements import TrackedPoints
from pacnerf_lpo.data.recordings.conventions import check_rotation
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Box, Video

log = logging.getLogger(__name__)

STEP_TOLERANCE = 0.02
"""Times written as 0.042, 0.083 (24 Hz, three digits) still count as uniform."""
FULL_IMAGE = 0.98
"""A silhouette that covers more of the image than this has no background."""
POINT_MARGIN = 0.1
"""A tracked point may start so far outside the box, as part of its diagonal."""
OUTSIDE_WARNING = 0.01
"""Fraction of a frame-0 silhouette that may lie outside the box before a warning."""
OUTSIDE_ERROR = 0.99
"""Fraction beyond which the object counts as missed."""
AXES_AND_UNITS = (
    "most likely axes or units differ: y must point up, cameras look along -z (OpenGL), poses and box are in metres; "
    "if so they are, move the box to the object"
)
"""What is wrong where every view misses the box: one wrong number of a box rarely does that."""


def check_box(lower: Sequence[float], upper: Sequence[float]) -> Box:
    """Corners as a Box: three finite numbers each, lower below upper."""
    for key, corner in (("box_lower", lower), ("box_upper", upper)):
        if len(corner) != 3 or not np.isfinite(corner).all():
            raise UserInputError(f"data.{key}: {list(corner)} must be three finite numbers, [x, y, z] in metres")
    for axis, low, high in zip("xyz", lower, upper, strict=True):
        if low >= high:
            raise UserInputError(f"data.box_lower: {axis} = {low:g} is not below {high:g} of data.box_upper; swap them")
    return Box((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))


def check_velocity(velocity: Sequence[float] | None) -> Sequence[float]:
    """Three finite numbers; none: at rest."""
    if velocity is not None and (len(velocity) != 3 or not np.isfinite(velocity).all()):
        raise UserInputError(f"data.velocity: {list(velocity)} must be three finite numbers, [x, y, z] in m/s")
    return velocity or (0.0, 0.0, 0.0)


def check_views(key: str, views: Sequence[int], available: Sequence[int]) -> tuple[int, ...]:
    """The views asked for, each once and each among those that exist."""
    existing = ", ".join(map(str, available))
    if not views and key != "test_views":
        raise UserInputError(f"data.{key}: the list is empty; choose among {existing}")
    for view in views:
        if view not in available:
            raise UserInputError(f"data.{key}: view {view} does not exist; choose among {existing}")
        if list(views).count(view) > 1:
            raise UserInputError(f"data.{key}: view {view} is named twice; name it once")
    return tuple(views)


def check_overlap(train: Sequence[int], test: Sequence[int]) -> None:
    """Views both trained on and tested are allowed (the full-view baseline does so) and said aloud."""
    both = ", ".join(str(view) for view in test if view in train)
    if both:
        log.warning("data.test_views: %s also in data.train_views, so test figures there are not held out", both)


def check_frames(index: Index, frames: int | None) -> tuple[int, ...]:
    """The first ``frames`` frame ids, without a gap in their numbers."""
    available = index.frames()
    if not available:
        raise UserInputError(f"{index.path}: lists no video frame; add ./data/r_<camera>_0.png and those after it")
    if frames is not None and not 1 <= frames <= len(available):
        raise UserInputError(f"data.frames: {frames} is not in 1..{len(available)}, which is what the video has")
    chosen = available[:frames]
    missing = sorted(set(range(chosen[0], chosen[-1])) - set(chosen))
    if missing:
        raise UserInputError(f"{index.path}: no view has frame {missing[0]}; add it or cut the video with data.frames")
    return tuple(chosen)


def check_cameras(index: Index, views: Sequence[int], frames: Sequence[int]) -> None:
    """Every view has every frame, a rigid pose, and does not move; no two views are the same."""
    seen: dict[bytes, int] = {}
    for view in views:
        absent = [frame for frame in frames if (view, frame) not in index.shots]
        if absent:
            raise UserInputError(
                f"{index.path}: view {view} has no entry for frame {absent[0]}; add it, leave the view out of the "
                "config or cut the video with data.frames"
            )
        first = index.shots[view, frames[0]]
        moved = [frame for frame in frames if not _same_camera(first, index.shots[view, frame])]
        if moved:
            raise UserInputError(
                f"{index.where(view, moved[0])}: the camera moves after frame {frames[0]}; cameras must be fixed, mend "
                "'c2w' and 'intrinsic' or leave the view out of the config"
            )
        check_rotation(f"{index.where(view, frames[0])}, 'c2w'", first.camera_to_world[:, :3])
        camera = np.concatenate((first.camera_to_world.ravel(), first.intrinsic.ravel())).round(5) + 0.0
        if camera.tobytes() in seen:
            raise UserInputError(
                f"{index.where(view, frames[0])}: the same camera as view {seen[camera.tobytes()]}; mend its pose or "
                "remove one of the two views"
            )
        seen[camera.tobytes()] = view


def _same_camera(one: Shot, other: Shot) -> bool:
    return np.allclose(one.camera_to_world, other.camera_to_world, rtol=0.0, atol=1e-5) and np.allclose(
        one.intrinsic, other.intrinsic, rtol=1e-5
    )


def check_times(index: Index, views: Sequence[int], frames: Sequence[int]) -> list[float]:
    """Times of the frames [s]: the same in all views, increasing, evenly spaced."""
    times = [index.shots[views[0], frame].time for frame in frames]
    step = (times[-1] - times[0]) / max(len(times) - 1, 1)
    for frame, before, after in zip(frames[1:], times[:-1], times[1:], strict=True):
        where = index.where(views[0], frame)
        if after <= before:
            raise UserInputError(f"{where}: times do not increase ({after:g} s follows {before:g} s); mend 'time'")
        if abs(after - before - step) > STEP_TOLERANCE * step:
            raise UserInputError(
                f"{where}: frames are not evenly spaced ({after - before:.4g} s after the last, not {step:.4g} s)"
                "; mend 'time' or cut the video with data.frames"
            )
    for view in views:
        for frame, time in zip(frames, times, strict=True):
            if abs(index.shots[view, frame].time - time) > STEP_TOLERANCE * step:
                raise UserInputError(
                    f"{index.where(view, frame)}: taken at {index.shots[view, frame].time:g} s, but in view {views[0]} "
                    f"at {time:g} s; cameras must be synchronous, mend 'time'"
                )
    return times


def check_offsets(index: Index, views: Sequence[int], frames: Sequence[int], step: float) -> tuple[float, ...]:
    """How much later than stamped each view was taken [s]: one per view, less than the ``step`` of frames [s]."""
    found = []
    for view in views:
        offsets = {index.shots[view, frame].offset for frame in frames}
        worst = max(offsets, key=abs)
        if len(offsets) > 1 or abs(worst) > step:
            raise UserInputError(
                f"{index.where(view, frames[0])}: 'time_offset' ({worst:g} s) must be the same in all frames of a view "
                f"and less than the {step:.4g} s between two frames; shift the numbers of its frames, or mend it"
            )
        found.append(worst)
    return tuple(found) if any(found) else ()


def check_image_files(paths: Iterable[Path]) -> tuple[int, int]:
    """(height, width) that all files share; reads headers alone."""
    paths = list(paths)
    missing = [path for path in paths if not path.exists()]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        plate = missing[0].stem.endswith("_-1")
        mend = "raw images are matted by it" if plate else "leave its view out of the config or cut with data.frames"
        what, add = ("background plate", "add it: ") if plate else ("image", "add it, ")
        raise UserInputError(f"{missing[0]}: the {what} is missing{more}; {add}{mend}")
    with ThreadPoolExecutor() as pool:
        sizes = list(pool.map(image_size, paths))
    for path, size in zip(paths, sizes, strict=True):
        if size != sizes[0]:
            raise UserInputError(
                f"{path}: {_pixels(size)}, but {paths[0].name} has {_pixels(sizes[0])}; make them one size"
            )
    return sizes[0]


def check_intrinsics_fit(index: Index, views: Sequence[int], size: tuple[int, int]) -> None:
    """Focal lengths positive, no skew, principal point within the image of ``size`` (height, width)."""
    for view in views:
        shot = index.camera(view)
        where = f"{index.path}, entry {shot.entry} (view {view})"
        (fx, skew, cx), (tilt, fy, cy), last = shot.intrinsic.tolist()
        if fx <= 0 or fy <= 0:
            raise UserInputError(f"{where}: focal lengths {fx:g}, {fy:g} must be positive; mend 'intrinsic'")
        if abs(skew) > 1e-3 * fx or tilt != 0 or last != [0, 0, 1]:
            raise UserInputError(
                f"{where}: 'intrinsic' must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew; rectify"
            )
        if not (0 < cx < size[1] and 0 < cy < size[0]):
            raise UserInputError(
                f"{where}: the principal point ({cx:g}, {cy:g}) lies outside the image of {_pixels(size)}; scale "
                "'intrinsic' to the size of the files"
            )


def check_occluder(path: Path, image: np.ndarray, size: tuple[int, int]) -> None:
    """The occluder has transparency and the size (height, width) of the images."""
    if image.shape[-1] != 4:
        raise UserInputError(f"{path}: an occluder (frame -2) needs an alpha channel; save it as RGBA or remove it")
    if image.shape[:2] != size:
        raise UserInputError(f"{path}: {_pixels(image.shape)}, but the images have {_pixels(size)}; make them one size")


def _pixels(size: Sequence[int]) -> str:
    return f"{size[1]} x {size[0]} pixels"


def check_visible(video: Video, train: Sequence[int]) -> None:
    """Every training view (index) shows the object on white at the first frame; later it may leave the image."""
    for index in train:
        view, shown = video.view_ids[index], (video.silhouettes[index] > 0.5).flatten(1).any(dim=1)
        if not shown.any():
            raise UserInputError(
                f"{video.source}: view {view} never shows the object (all its images are white); leave it out of "
                "data.train_views or mend its images"
            )
        if not shown[0]:
            raise UserInputError(
                f"{video.source}: view {view} shows no object at frame {video.frame_ids[0]}, where the shape is learnt"
                "; leave it out of data.train_views or mend that image"
            )
        if video.silhouettes[index, 0].mean() > FULL_IMAGE:
            raise UserInputError(
                f"{video.source}: view {view} has no background at frame {video.frame_ids[0]}; matted images need the "
                "object on pure white, raw ones (data.background: raw) the background plate of the same camera"
            )


def check_points_in_box(tracks: TrackedPoints, video: Video, box: Box) -> None:
    """Tracked points that are seen at frame 0 lie in the box, or near it."""
    early = tracks.seen_until(float(video.times[0]))
    names, rows = np.unique(early.ids, return_index=True)
    lower, upper = np.array(box.lower), np.array(box.upper)
    outside = np.maximum(lower - early.positions[rows], early.positions[rows] - upper).max(1, initial=-np.inf)
    if len(names) and outside.max() > POINT_MARGIN * float(np.linalg.norm(upper - lower)):
        worst = int(outside.argmax())
        raise UserInputError(
            f"{tracks.source}: id {names[worst]} is {outside[worst]:.3g} m outside the box of the object at frame "
            f"{video.frame_ids[0]}, {list(box.lower)} to {list(box.upper)} m; check units, axes (y is up) and the clock"
        )


def check_box_seen(video: Video, box: Box, train: Sequence[int]) -> None:
    """Every training view (index) sees the box; a warning where part of the object lies outside it at frame 0."""
    size, blind, outside = video.images.shape[2:4], [], {}
    for index in train:
        rays = pixel_rays(video.intrinsics[index], video.camera_to_world[index], *size)
        inside, silhouette = hits_box(rays, box), video.silhouettes[index, 0].flatten() > 0.5
        blind += [] if inside.any() else [str(video.view_ids[index])]
        outside[video.view_ids[index]] = float((silhouette & ~inside).sum() / silhouette.sum())
    corners = f"{list(box.lower)} to {list(box.upper)} m"
    if len(blind) == len(train):
        raise UserInputError(
            f"{video.source}: no training view sees the box data.box_lower, data.box_upper = {corners}; "
            f"{AXES_AND_UNITS}"
        )
    if blind:
        raise UserInputError(
            f"data.box_lower, data.box_upper: training view {', '.join(blind)} does not see the box {corners}; move "
            "the box to the object or leave the view out"
        )
    if min(outside.values()) > OUTSIDE_ERROR:
        raise UserInputError(
            f"{video.source}: the box data.box_lower, data.box_upper = {corners} misses the object in every training "
            f"view at frame 0; {AXES_AND_UNITS}"
        )
    worst = max(outside, key=lambda view: outside[view])
    if outside[worst] > OUTSIDE_WARNING:
        log.warning(
            f"data.box_lower, data.box_upper: {100 * outside[worst]:.0f}% of the object in view {worst} at frame 0 "
            f"lies outside the box {corners}; enlarge it, or that part cannot be learnt"
        )
