"""PhysTwin: ``calibrate.pkl`` with camera-to-world poses, ``metadata.json``, ``color/<camera>/<frame>.png``."""

from pathlib import Path

from pacnerf_lpo.data.recordings.conventions import half_pixel_centres, opengl_axes
from pacnerf_lpo.data.recordings.files import entry, number_at, numbers, read_arrays, read_values
from pacnerf_lpo.data.recordings.media import images_in
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.errors import UserInputError


def read(folder: Path) -> Recording:
    """OpenCV cameras, metres, z down. Depth images are not used."""
    path, data = folder / "calibrate.pkl", read_values(folder / "metadata.json")
    poses, where = read_arrays(path), str(folder / "metadata.json")
    intrinsics = entry(where, data, "intrinsics")
    width, height = numbers(f"{where}, WH", entry(where, data, "WH"), (2,)).astype(int).tolist()
    fps = number_at(where, data, "fps")
    if fps <= 0:
        raise UserInputError(f"{where}: 'fps' is {fps:g}; give the frames per second, a positive number")
    if len(poses) != len(intrinsics):
        raise UserInputError(f"{path}: {len(poses)} poses, but metadata.json has {len(intrinsics)} intrinsics")
    cameras = []
    for number, (pose, intrinsic) in enumerate(zip(poses, intrinsics, strict=True)):
        images = images_in(folder / "color" / str(number))
        matrix = half_pixel_centres(numbers(f"{where}, intrinsics {number}", intrinsic, (3, 3)))
        turned = opengl_axes(numbers(f"{path}, pose {number}", pose, (4, 4), (3, 4)))
        frames = tuple(Frame(image, place / fps) for place, image in enumerate(images))
        cameras.append(Camera(str(number), matrix, turned, frames, size=(width, height)))
    return Recording(LAYOUT.name, folder, tuple(cameras), unit=1.0, up=(0.0, 0.0, -1.0))


LAYOUT = Layout("phystwin", "calibrate.pkl and metadata.json", has("calibrate.pkl"), read)
