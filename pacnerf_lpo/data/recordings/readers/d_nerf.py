"""D-NeRF: ``transforms_<split>.json`` with one field of view, and a pose and a time per image."""

from dataclasses import replace
from pathlib import Path

from pacnerf_lpo.data.index import NAME as PAC_NERF
from pacnerf_lpo.data.recordings.files import entry, number_at, read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.readers.nerfstudio import shot_of
from pacnerf_lpo.data.recordings.readers.poses import still_cameras
from pacnerf_lpo.data.recordings.recording import Recording

SPLITS = ("train", "val", "test")


def read(folder: Path) -> Recording:
    """OpenGL cameras of all splits. Its times go from 0 to 1 whatever the length, so they are the order alone."""
    shots = []
    for path in (folder / f"transforms_{split}.json" for split in SPLITS):
        if path.is_file():
            values = read_values(path)
            number_at(str(path), values, "camera_angle_x")
            for number, frame in enumerate(entry(str(path), values, "frames")):
                number_at(f"{path}, frame {number}", frame, "time")
                shots.append(shot_of(path, number, {**values, **frame}))
    found = still_cameras(folder, shots)
    cameras = (replace(one, frames=tuple(replace(frame, time=None) for frame in one.frames)) for one in found)
    return Recording(LAYOUT.name, folder, tuple(cameras))


LAYOUT = Layout("d-nerf", "transforms_train.json", has("transforms_train.json", without=PAC_NERF), read)
