"""The difference matte, on a drawn scene whose answer is known and on path-traced raw images."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from pacnerf_lpo.data.images import read_png, white_silhouette
from pacnerf_lpo.data.matting import matte
from tests.data.conftest import load


def drawn(noise: float = 0.02, shadow: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Raw image, plate, true opacity and true colour of a ring over a textured floor with a soft shadow."""
    generator = np.random.default_rng(0)
    rows, columns = np.mgrid[0:96, 0:96] - 47.5
    texture = ndimage.gaussian_filter(generator.standard_normal((96, 96, 3)), (2, 2, 0))
    plate = np.clip([0.7, 0.62, 0.78] + 0.25 * texture, 0, 1)
    alpha = np.clip(26 - np.hypot(rows, columns), 0, 1) * np.clip(np.hypot(rows, columns) - 12, 0, 1)
    colour = np.where((columns < 0)[..., None], [0.9, 0.45, 0.55], [0.4, 0.85, 0.4]) * np.ones((96, 96, 1))
    darkness = 0.5 * np.exp(-(np.hypot(rows - 20, columns) ** 2) / 600) if shadow else np.zeros((96, 96))
    image = alpha[..., None] * colour + (1 - alpha[..., None]) * plate * (1 - darkness[..., None])
    image = np.clip(image + noise * generator.standard_normal(image.shape), 0, 1)
    return image.astype(np.float32), plate.astype(np.float32), alpha, colour


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


@pytest.mark.parametrize("shadow", [False, True])
def test_drawn_ring_is_cut_out_with_its_hole(shadow):
    image, plate, alpha, _ = drawn(shadow=shadow)
    found = matte(image, plate)[1]
    assert iou(found > 0.5, alpha > 0.5) > 0.95
    assert found[48, 48] == 0.0 and found[0, 0] == 0.0
    soft = (alpha > 0.1) & (alpha < 0.9)
    # noise 0.02 over a colour step of 0.35 is 0.06; foreground and shade are estimates as well
    assert np.abs(found - alpha)[soft].mean() < 0.2


def test_rim_is_composed_onto_white_without_the_floor():
    image, plate, alpha, colour = drawn()
    found, _ = matte(image, plate)
    truth = alpha[..., None] * colour + 1 - alpha[..., None]
    rim = (alpha > 0.1) & (alpha < 0.9)
    raw = alpha[..., None] * colour + (1 - alpha[..., None]) * plate
    assert np.abs(found - truth)[rim].mean() < 0.7 * np.abs(raw - truth)[rim].mean()
    assert (found[:8] == 1.0).all()


def test_empty_image_gives_an_empty_matte():
    _, plate, _, _ = drawn()
    noisy = np.clip(plate + 0.02 * np.random.default_rng(1).standard_normal(plate.shape), 0, 1).astype(np.float32)
    colour, alpha = matte(0.7 * noisy, plate)
    assert not alpha.any() and (colour == 1.0).all()


def test_raw_scene_is_matted_when_read(scene):
    image, plate, alpha, _ = drawn(noise=0.0)
    for path in sorted((scene / "data").glob("m_*.png")):
        path.unlink()
        view = path.stem.split("_")[1]
        for name, pixels in ((f"r{path.name[1:]}", image), (f"r_{view}_-1.png", plate)):
            Image.fromarray((pixels[::3, ::3] * 255).astype(np.uint8)).save(scene / "data" / name)
    video = load(scene).video
    assert iou(video.silhouettes[1, 2].numpy() > 0.5, alpha[::3, ::3] > 0.5) > 0.85
    assert (video.images[1, 2][:2] == 1.0).all()


@pytest.mark.slow
def test_path_traced_torus_is_cut_out(shared_data):
    """Noise, contact shadows, light thrown back by the floor; the given silhouettes leave out mixed rim pixels."""
    folder, scores = shared_data / "torus" / "data", []
    for view in range(11):
        plate = read_png(folder / f"r_{view}_-1.png")
        for frame in range(0, 14, 2):
            truth = white_silhouette(read_png(folder / f"m_{view}_{frame}.png")) > 0.5
            scores.append(iou(matte(read_png(folder / f"r_{view}_{frame}.png"), plate)[1] > 0.5, truth))
    # one row of mixed pixels around an outline of 250 to 350 pixels would cost 0.05 to 0.07
    assert min(scores) > 0.95 and np.mean(scores) > 0.97
