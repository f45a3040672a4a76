"""PAC-NeRF: ``all_data.json`` with one pose per image, ``data/r_<camera>_<frame>.png``, plates as frame -1."""

from pathlib import Path

from pacnerf_lpo.data.checks import check_cameras, image_folder
from pacnerf_lpo.data.index import NAME, read_index
from pacnerf_lpo.data.pac_nerf import Files
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording


def read(folder: Path) -> Recording:
    """Matted images where there are any, else raw ones with their plates; metres, y up, the ground at y = 0."""
    index = read_index(folder)
    frames = index.frames()
    check_cameras(index, index.views(), frames)
    images = image_folder(folder)
    matted = any(images.glob("m_*_*.png"))
    cameras = []
    for view in index.views():
        files, shot = Files(images, (view,), tuple(frames), matted), index.camera(view)
        taken = [index.shots[view, frame].time + index.shots[view, frame].offset for frame in frames]
        shots = tuple(Frame(files.image(view, frame), time) for frame, time in zip(frames, taken, strict=True))
        plate = files.plate(view) if not matted and files.plate(view).exists() else None
        cameras.append(Camera(str(view), shot.intrinsic, shot.camera_to_world, shots, plate=plate, on_white=matted))
    return Recording(LAYOUT.name, folder, tuple(cameras), unit=1.0, up=(0.0, 1.0, 0.0), ground=0.0)


GIC = "transforms_train.json"
LAYOUT = Layout("pac-nerf", f"{NAME} without {GIC}", has(NAME, without=GIC), read)
