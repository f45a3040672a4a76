"""Inconsistencies of a scene, found before training starts. Each raises UserInputError: what, which file, how to mend."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.cameras import hits_box, pixel_rays
from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.index import Index
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Box, Video

log = logging.getLogger(__name__)

ROTATION_TOLERANCE = 1e-3
"""Poses written with four digits still pass."""
STEP_TOLERANCE = 0.02
"""Times written as 0.042, 0.083 (24 Hz, three digits) still count as uniform."""
OUTSIDE_WARNING = 0.01


def check_image_scale(scale: float) -> None:
    """The scale must shrink, and leave something."""
    if not 0.0 < scale <= 1.0:
        raise UserInputError(f"data.image_scale: {scale} is not in 0 < scale <= 1; 0.5 halves width and height")


def image_folder(root: Path) -> Path:
    """``root/data``, which must exist and hold images."""
    folder = root / "data"
    if not folder.is_dir() or not any(folder.glob("*.png")):
        raise UserInputError(f"{folder}: no PNG images there; expected m_<camera>_<frame>.png or r_<camera>_<frame>.png")
    return folder


def check_views(key: str, views: Sequence[int], available: Sequence[int]) -> tuple[int, ...]:
    """The views asked for, each once and each among those that exist."""
    for view in views:
        if view not in available:
            raise UserInputError(f"data.{key}: view {view} does not exist; there are {', '.join(map(str, available))}")
        if list(views).count(view) > 1:
            raise UserInputError(f"data.{key}: view {view} is named twice; name it once")
    if not views and key == "train_views":
        raise UserInputError(f"data.{key}: the list is empty; name views among {', '.join(map(str, available))}")
    return tuple(views)


def check_frames(index: Index, frames: int | None) -> tuple[int, ...]:
    """The first ``frames`` frame ids, without a gap in their numbers."""
    available = index.frames()
    if not available:
        raise UserInputError(f"{index.path}: lists no video frame (frame ids from 0 on); add r_<camera>_0.png and so on")
    if frames is not None and not 1 <= frames <= len(available):
        raise UserInputError(f"data.frames: {frames} asked for, but the video has {len(available)}; choose 1 to that")
    chosen = available[:frames]
    missing = sorted(set(range(chosen[0], chosen[-1])) - set(chosen))
    if missing:
        raise UserInputError(f"{index.path}: frame {missing[0]} is missing in every view; add it or shorten data.frames")
    return tuple(chosen)


def check_cameras(index: Index, views: Sequence[int], frames: Sequence[int]) -> None:
    """Every view has every frame, a rigid pose, and does not move; no two views share a pose."""
    seen: dict[bytes, int] = {}
    for view in views:
        for frame in frames:
            if (view, frame) not in index.shots:
                raise UserInputError(f"{index.path}: view {view} has no entry for frame {frame}; add it, drop the view "
                                     "from the config or shorten data.frames")
        first = index.shots[view, frames[0]]
        for frame in frames:
            shot = index.shots[view, frame]
            if not (np.allclose(shot.camera_to_world, first.camera_to_world, rtol=0.0, atol=1e-5)
                    and np.allclose(shot.intrinsic, first.intrinsic, rtol=1e-5)):
                raise UserInputError(f"{index.path}, entry {shot.entry}: camera {view} moves between frames {frames[0]} "
                                     f"and {frame}; only fixed cameras are supported, so mend the pose or drop the view")
        check_pose(f"{index.path}, entry {first.entry} (view {view})", first.camera_to_world)
        pose = first.camera_to_world.round(6).tobytes() + first.intrinsic.round(4).tobytes()
        if pose in seen:
            raise UserInputError(f"{index.path}: views {seen[pose]} and {view} have the same pose; mend or remove one")
        seen[pose] = view


def check_pose(where: str, pose: np.ndarray) -> None:
    """The left 3 x 3 block is a rotation: orthonormal and right-handed."""
    rotation = pose[:, :3]
    error = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if error > ROTATION_TOLERANCE:
        raise UserInputError(f"{where}: the rotation in 'c2w' is not orthonormal (off by {error:.2g}); export it again")
    if np.linalg.det(rotation) < 0:
        raise UserInputError(f"{where}: the rotation in 'c2w' is mirrored (determinant -1); flip one axis")


def check_times(index: Index, views: Sequence[int], frames: Sequence[int]) -> list[float]:
    """Times of the frames [s]: the same in all views, increasing, evenly spaced."""
    times = [index.shots[views[0], frame].time for frame in frames]
    if len(times) == 1:
        return times
    step = (times[-1] - times[0]) / (len(times) - 1)
    for frame, before, after in zip(frames[1:], times[:-1], times[1:], strict=True):
        if after <= before:
            raise UserInputError(f"{index.path}: times do not increase (frame {frame} at {after:g} s follows {before:g} s)"
                                 "; mend 'time'")
        if abs(after - before - step) > STEP_TOLERANCE * step:
            raise UserInputError(f"{index.path}: frames are not evenly spaced in time (frame {frame} comes {after - before:g}"
                                 f" s after the last, {step:g} s on average); mend 'time' or cut with data.frames")
    for view in views:
        for frame, time in zip(frames, times, strict=True):
            shot = index.shots[view, frame]
            if abs(shot.time - time) > STEP_TOLERANCE * step:
                raise UserInputError(f"{index.path}, entry {shot.entry}: view {view} has frame {frame} at {shot.time:g} s, "
                                     f"view {views[0]} at {time:g} s; cameras must be synchronous, mend 'time'")
    return times


def check_image_files(paths: Iterable[Path]) -> tuple[int, int]:
    """(height, width) that all files share; reads headers alone."""
    paths = list(paths)
    missing = [path for path in paths if not path.exists()]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        hint = "the background plate is needed to matte raw images; add it" if missing[0].stem.endswith("_-1") else (
            "add it, leave its view out of the config or shorten data.frames")
        raise UserInputError(f"{missing[0]}: the image is missing{more}; {hint}")
    with ThreadPoolExecutor() as pool:
        sizes = list(pool.map(image_size, paths))
    for path, size in zip(paths, sizes, strict=True):
        if size != sizes[0]:
            raise UserInputError(f"{path}: {size[1]} x {size[0]} pixels, but {paths[0].name} has {sizes[0][1]} x "
                                 f"{sizes[0][0]}; all images need one size")
    return sizes[0]


def check_intrinsics_fit(index: Index, views: Sequence[int], height: int, width: int) -> None:
    """Focal lengths positive, no skew, principal point within the image."""
    for view in views:
        shot = index.camera(view)
        matrix, where = shot.intrinsic, f"{index.path}, entry {shot.entry} (view {view})"
        if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise UserInputError(f"{where}: focal lengths {matrix[0, 0]:g}, {matrix[1, 1]:g} must be positive; mend "
                                 "'intrinsic'")
        if abs(matrix[0, 1]) > 1e-3 * matrix[0, 0] or not np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1]):
            raise UserInputError(f"{where}: 'intrinsic' must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew; "
                                 "rectify the images")
        if not (0 < matrix[0, 2] < width and 0 < matrix[1, 2] < height):
            raise UserInputError(f"{where}: the principal point ({matrix[0, 2]:g}, {matrix[1, 2]:g}) lies outside the "
                                 f"{width} x {height} image; scale 'intrinsic' to the size of the files")


def check_occluder(path: Path, pixels: np.ndarray, size: tuple[int, int]) -> None:
    """The occluder has transparency and the size of the images."""
    if pixels.shape[-1] != 4:
        raise UserInputError(f"{path}: an occluder (frame -2) needs an alpha channel; save it as RGBA or remove it")
    if pixels.shape[:2] != size:
        raise UserInputError(f"{path}: {pixels.shape[1]} x {pixels.shape[0]} pixels, the images have {size[1]} x {size[0]}"
                             "; save it in their size")


def check_box(lower: Sequence[float], upper: Sequence[float]) -> Box:
    """Corners as a Box: three finite numbers each, lower below upper."""
    for key, corner in (("box_lower", lower), ("box_upper", upper)):
        if len(corner) != 3 or not np.isfinite(corner).all():
            raise UserInputError(f"data.{key}: {list(corner)} must be three finite numbers, [x, y, z] in metres")
    for axis, low, high in zip("xyz", lower, upper, strict=True):
        if low >= high:
            raise UserInputError(f"data.box_lower: {low:g} is not below data.box_upper {high:g} along {axis}; swap them")
    return Box((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))


def check_visible(video: Video, train: Sequence[int]) -> None:
    """Every training view shows the object at the first frame (later it may leave the image)."""
    for index in train:
        view, frame = video.view_ids[index], video.frame_ids[0]
        if not (video.silhouettes[index] > 0.5).any():
            raise UserInputError(f"{video.source}: view {view} never shows the object (all frames are white); "
                                 "take it out of data.train_views or mend its images")
        if not (video.silhouettes[index, 0] > 0.5).any():
            raise UserInputError(f"{video.source}: view {view} shows nothing at frame {frame}, where the shape is learnt; "
                                 "take it out of data.train_views or mend that image")


def check_box_seen(video: Video, box: Box, train: Sequence[int]) -> None:
    """Every training view sees the box, and the object at frame 0 lies in it (a warning where a part sticks out)."""
    height, width = video.images.shape[2:4]
    blind, fractions = [], {}
    for index in train:
        inside = hits_box(pixel_rays(video.intrinsics[index], video.camera_to_world[index], height, width), box)
        silhouette = video.silhouettes[index, 0].reshape(-1) > 0.5
        if not inside.any():
            blind.append(video.view_ids[index])
        fractions[video.view_ids[index]] = float((silhouette & ~inside).sum() / silhouette.sum())
    corners = f"the box {list(box.lower)} to {list(box.upper)} m"
    if blind:
        raise UserInputError(f"data.box_lower, data.box_upper: {corners} is outside the image of training view"
                             f"{'s' if len(blind) > 1 else ''} {', '.join(map(str, blind))}; move it to the object")
    worst = max(fractions, key=lambda view: fractions[view])
    if all(fraction > 0.99 for fraction in fractions.values()):
        raise UserInputError(f"data.box_lower, data.box_upper: {corners} misses the object in every training view at "
                             "frame 0; move it to the object")
    if fractions[worst] > OUTSIDE_WARNING:
        log.warning("data.box_lower, data.box_upper: %.0f%% of the object in view %d at frame 0 lies outside %s; enlarge it "
                    "or that part cannot be learnt", 100 * fractions[worst], worst, corners)


def check_overlap(train: Sequence[int], test: Sequence[int]) -> None:
    """Views both trained on and tested are allowed (the full-view baseline does so) and said aloud."""
    both = [view for view in test if view in train]
    if both:
        log.warning("data.test_views: view%s %s also in data.train_views; test figures there are not held out",
                    "s" if len(both) > 1 else "", ", ".join(map(str, both)) + (" are" if len(both) > 1 else " is"))
