"""PAC-NeRF's layout: ``all_data.json`` and ``data/{r,m}_{camera}_{frame}.png``.

``m_`` images are already matted onto white; ``r_`` images are raw, with a background plate of each camera as frame -1.
Frame -2 of a camera is an optional occluder: rays where its alpha exceeds 50 of 255 carry no information.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm
from tqdm.contrib.concurrent import thread_map

from pacnerf_lpo.data import checks
from pacnerf_lpo.data.assets import resolve_root
from pacnerf_lpo.data.images import area_average, on_white, read_png
from pacnerf_lpo.data.index import Index, read_index
from pacnerf_lpo.data.matting import matte
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Video

Background = Literal["auto", "matted", "raw"]
PLATE, OCCLUDER = -1, -2
OCCLUDER_ALPHA = 50 / 255


@dataclass(frozen=True)
class Files:
    """Where the images of the chosen views and frames lie, and whether they are matted."""

    folder: Path
    views: tuple[int, ...]
    frames: tuple[int, ...]
    matted: bool

    def image(self, view: int, frame: int) -> Path:
        """A frame of the video, or PLATE or OCCLUDER, which are never matted."""
        return self.folder / f"{'m' if self.matted and frame >= 0 else 'r'}_{view}_{frame}.png"

    def needed(self) -> list[Path]:
        """Every file that has to be there."""
        frames = self.frames if self.matted else (*self.frames, PLATE)
        return [self.image(view, frame) for view in self.views for frame in frames]


def read_pac_nerf(
    root: str | Path,
    views: Sequence[int] | None = None,
    frames: int | None = None,
    image_scale: float = 1.0,
    background: Background = "auto",
) -> Video:
    """Read a multi-view video, matte it where it is raw, and scale it.

    views: file ids of the cameras wanted (None: all); frames: how many from the first (None: all);
    image_scale: 0 < scale <= 1, by area averaging; background: which images, "auto" takes matted ones if there are any.
    Raises UserInputError for every inconsistency found, before any image is decoded where that is possible.
    """
    root = Path(root)
    if not 0.0 < image_scale <= 1.0:
        raise UserInputError(f"data.image_scale: {image_scale} is not in 0 < scale <= 1; 0.5 halves width and height")
    index = read_index(root)
    files = choose_files(index, views, frames, background)
    checks.check_cameras(index, files.views, files.frames)
    times = checks.check_times(index, files.views, files.frames)
    offsets = checks.check_offsets(index, files.views, files.frames, times[1] - times[0] if len(times) > 1 else 1.0)
    height, width = checks.check_image_files(files.needed())
    shots = [index.camera(view) for view in files.views]
    intrinsics = torch.tensor(np.stack([shot.intrinsic for shot in shots]), dtype=torch.float32)
    poses = torch.tensor(np.stack([shot.camera_to_world for shot in shots]), dtype=torch.float32)
    checks.check_intrinsics_fit(index, files.views, (height, width))

    scaled = (max(1, round(height * image_scale)), max(1, round(width * image_scale)))
    factors = intrinsics.new_tensor([scaled[1] / width, scaled[0] / height, 1.0])  # edges stay edges, centres at +0.5
    images, silhouettes = load_images(files, scaled)
    return Video(
        images=images,
        silhouettes=silhouettes,
        valid=torch.stack([load_valid(files, view, (height, width), scaled) for view in files.views]),
        camera_to_world=poses,
        intrinsics=intrinsics * factors[:, None],
        times=torch.tensor(times, dtype=torch.float32),
        view_ids=files.views,
        frame_ids=files.frames,
        source=str(root),
        offsets=offsets,
    )


def choose_files(index: Index, views: Sequence[int] | None, frames: int | None, background: Background) -> Files:
    """The views, frames and kind of image that were asked for. Raises UserInputError where they do not exist."""
    folder = index.path.parent / "data"
    if not folder.is_dir() or not any(folder.glob("[mr]_*_*.png")):
        raise UserInputError(f"{folder}: no images there; put m_<camera>_<frame>.png or r_<camera>_<frame>.png in it")
    available = index.views()
    chosen = tuple(available) if views is None else checks.check_views("views", views, available)
    frame_ids = checks.check_frames(index, frames)
    matted = background == "matted" or (background == "auto" and any(folder.glob("m_*_*.png")))
    return Files(folder, chosen, frame_ids, matted)


def load_images(files: Files, scaled: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Images on white (V, F, h, w, 3) and silhouettes (V, F, h, w), decoded by all cores."""
    shape = (len(files.views), len(files.frames), *scaled)
    images, silhouettes = torch.empty(*shape, 3), torch.empty(shape)
    plates = {} if files.matted else {view: read_png(files.image(view, PLATE))[..., :3] for view in files.views}

    def load(place: tuple[int, int]) -> None:
        view, frame = files.views[place[0]], files.frames[place[1]]
        pixels = read_png(files.image(view, frame))
        colour, silhouette = on_white(pixels) if files.matted else matte(pixels[..., :3], plates[view])
        both = torch.from_numpy(np.concatenate((colour, silhouette[..., None]), axis=-1))
        both = area_average(both, *scaled)
        images[place], silhouettes[place] = both[..., :3], both[..., 3]

    thread_map(
        load, list(np.ndindex(shape[:2])), tqdm_class=tqdm, desc=f"reading {files.folder}", delay=2.0, leave=False
    )
    return images, silhouettes


def load_valid(files: Files, view: int, size: tuple[int, int], scaled: tuple[int, int]) -> Tensor:
    """True where no part of the pixel lies behind the occluder of a view (h, w); all True where there is none."""
    occluder = files.image(view, OCCLUDER)
    if not occluder.exists():
        return torch.ones(scaled, dtype=torch.bool)
    pixels = read_png(occluder)
    checks.check_occluder(occluder, pixels, size)
    hidden = torch.from_numpy(pixels[..., 3:] > OCCLUDER_ALPHA).float()
    return area_average(hidden, *scaled)[..., 0] == 0


def data_digest(section: Mapping[str, Any]) -> str:
    """Hash of the contents of all files that a section ``data`` reads; UserInputError where it cannot be read."""
    index = read_index(resolve_root(section["root"]))
    views = index.views()
    if section["train_views"] is not None and section["test_views"] is not None:
        views = sorted({*section["train_views"], *section["test_views"]})
    chosen = choose_files(index, views, section["frames"], section["background"])
    occluders = [path for view in views if (path := chosen.image(view, OCCLUDER)).exists()]
    digest = hashlib.sha256(file_digest(index.path))
    for path in (*chosen.needed(), *occluders):
        digest.update(path.name.encode())
        digest.update(file_digest(path))
    return digest.hexdigest()


@cache
def file_digest(path: Path) -> bytes:
    """SHA-256 of a file's contents; each file is read once per process."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except OSError as error:
        raise UserInputError(f"{path}: {error.strerror}") from None
