"""PAC-NeRF: ``all_data.json`` with one pose per image, ``data/r_<camera>_<frame>.png``, plates as frame -1. GIC: the
same with ``transforms_train.json``, images ``m_`` on white and, transparent, ``a_``.
"""

from dataclasses import replace
from pathlib import Path

from pacnerf_lpo.data.checks import check_cameras
from pacnerf_lpo.data.index import NAME, read_index
from pacnerf_lpo.data.pac_nerf import PLATE, choose_files
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording


def read(folder: Path) -> Recording:
    """Matted images where there are any, else raw ones with their plates; metres, y up, the ground at y = 0."""
    index = read_index(folder)
    files = choose_files(index, None, None, "auto")
    check_cameras(index, files.views, files.frames)
    cameras = []
    for view in files.views:
        shot, stamps = index.camera(view), [(frame, index.shots[view, frame]) for frame in files.frames]
        frames = tuple(Frame(files.image(view, frame), own.time + own.offset) for frame, own in stamps)
        behind, pose = files.image(view, PLATE), shot.camera_to_world
        plate = behind if not files.matted and behind.exists() else None
        cameras.append(Camera(str(view), shot.intrinsic, pose, frames, plate=plate, on_white=files.matted))
    return Recording(LAYOUT.name, folder, tuple(cameras), unit=1.0, up=(0.0, 1.0, 0.0), ground=0.0)


def read_gic(folder: Path) -> Recording:
    """As PAC-NeRF's layout, with the transparent images ``a_`` where there are any."""
    recording = read(folder)
    cameras = []
    for camera in recording.cameras:
        frames = tuple(replace(f, file=f.file.with_name("a" + f.file.name[1:])) for f in camera.frames)
        there = all(frame.file.is_file() for frame in frames)
        cameras.append(replace(camera, frames=frames, plate=None, on_white=False) if there else camera)
    return replace(recording, layout=GIC.name, cameras=tuple(cameras))


MARK = "transforms_train.json"
LAYOUT = Layout("pac-nerf", f"{NAME} without {MARK}", has(NAME, without=MARK), read)
GIC = Layout("gic", f"{NAME} and {MARK}", has(NAME, MARK), read_gic)
