"""GIC: PAC-NeRF's files with ``transforms_train.json``, images ``m_`` on white and, transparent, ``a_``."""

from dataclasses import replace
from pathlib import Path

from pacnerf_lpo.data.index import NAME
from pacnerf_lpo.data.recordings.readers import pac_nerf
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Recording


def read(folder: Path) -> Recording:
    """As PAC-NeRF's layout, with the transparent images ``a_`` where there are any."""
    recording = pac_nerf.read(folder)
    cameras = tuple(_transparent(camera) for camera in recording.cameras)
    return replace(recording, layout=LAYOUT.name, cameras=cameras)


def _transparent(camera: Camera) -> Camera:
    frames = tuple(replace(f, file=f.file.with_name("a" + f.file.name[1:])) for f in camera.frames)
    if not all(frame.file.is_file() for frame in frames):
        return camera
    return replace(camera, frames=frames, plate=None, on_white=False)


LAYOUT = Layout("gic", f"{NAME} and transforms_train.json", has(NAME, "transforms_train.json"), read)
