"""Mattes from videos alone: a body that stays where it falls, one that comes back to where it was, what views add."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy import ndimage

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.images import read_png
from pacnerf_lpo.data.matting import matte
from pacnerf_lpo.data.recordings.background import Background, expected_overlap, solid_part, still_background
from pacnerf_lpo.data.recordings.footage import Footage
from pacnerf_lpo.data.recordings.other_views import UNSURE, Silhouettes, expectations
from pacnerf_lpo.data.recordings.written_scene import View
from tests.data.recordings.layouts import write_json
from tests.data.recordings.studio import (
    CONTACT,
    SIZE,
    START,
    VIEWS,
    World,
    film,
    intrinsic,
    opencv_intrinsic,
    rig,
    save_video,
)

NOISE = 0.03
RESTING = np.concatenate((np.arange(8.0), np.full(6, 10.0)))
"""Moments [frames of the studio]: it falls, and lies still for nearly half of the recording."""
BOUNCE = np.concatenate((np.arange(8.0), np.arange(6.0, -1.0, -1.0)))
"""It comes back, so that first and last outline cover one another in all views."""


def textured(view: int) -> np.ndarray:
    """Coarse and fine noise in all colours [0..1, (SIZE, SIZE, 3)]."""
    noise = np.random.default_rng(view).standard_normal((2, SIZE, SIZE, 3))
    parts = [
        ndimage.gaussian_filter(one, (width, width, 0), mode="wrap") for one, width in zip(noise, (1, 5), strict=True)
    ]
    return np.clip(np.array([0.4, 0.5, 0.45]) + 0.1 * sum(part / part.std() for part in parts), 0.05, 0.95)


def filmed(view: int, moments: np.ndarray, backdrop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Noisy images with a soft shadow that follows the body [0..1, (F, SIZE, SIZE, 3)], and its outlines."""
    shown = film(view, moments)
    opacity = shown[..., 3:]
    shade = [1.0 - 0.5 * ndimage.gaussian_filter(np.roll(one, (9, 6), (0, 1)), (3, 3, 0)) for one in opacity]
    images = opacity * shown[..., :3] + (1.0 - opacity) * np.stack(shade) * backdrop
    noise = NOISE * np.random.default_rng(view).standard_normal(images.shape)
    return np.clip(images + noise, 0.0, 1.0).astype(np.float32), opacity[..., 0] > 0.5


def in_contact(view: int, backdrop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same, where the ground under the body is black to some pixels beside it once it has landed."""
    images, true = filmed(view, RESTING, backdrop)
    for image, body in zip(images[CONTACT:], true[CONTACT:], strict=False):
        under = ndimage.gaussian_filter(np.roll(body, (4, 1), (0, 1)).astype(float), 1.5)[..., None]
        image[...] = np.where(body[..., None], image, image * (1.0 - np.clip(1.6 * under, 0.0, 1.0)))
    return images, true


def overlaps(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return (found & true).sum(axis=(-2, -1)) / (found | true).sum(axis=(-2, -1))


def matted(images: np.ndarray) -> tuple[Background, np.ndarray, list[float]]:
    def pictures() -> Iterator[np.ndarray]:
        return iter(images)

    footage = Footage(pictures)
    found = still_background(footage)
    assert found is not None
    found = found.at_full_size(footage)
    odds = [found.denoised_odds(image) for image in images]
    solid = [solid_part(one) for one in odds]
    mattes = np.stack([matte(image, found.plate, one)[1] > 0.5 for image, one in zip(images, solid, strict=True)])
    return found, mattes, [expected_overlap(*pair) for pair in zip(odds, solid, strict=True)]


@pytest.mark.parametrize("moments", [RESTING, BOUNCE], ids=["rests", "comes back"])
@pytest.mark.parametrize("texture", [True, False], ids=["textured", "even"])
def test_a_body_before_a_still_camera(moments, texture):
    """Its outline is some eighty pixels long and its area seven hundred: a third of a pixel all around is 0.04."""
    backdrop = textured(1) if texture else np.full((SIZE, SIZE, 3), 0.55)
    images, true = filmed(1, moments, backdrop)
    found, solid, sure = matted(images)
    seen = overlaps(solid, true)
    assert seen.mean() > 0.96 and seen.min() > 0.93
    assert np.abs(found.plate - backdrop)[found.known].mean() < NOISE
    assert min(sure) > 0.9


@pytest.mark.parametrize("texture", [True, False], ids=["textured", "even"])
def test_a_black_contact_shadow_is_no_part_of_the_body(texture):
    """A matte with the shadow would overlap by less than 0.8."""
    backdrop = textured(1) if texture else np.full((SIZE, SIZE, 3), 0.55)
    images, true = in_contact(1, backdrop)
    black = images.mean(axis=-1) < 0.5 * backdrop.mean(axis=-1)
    assert overlaps(true | black, true)[CONTACT:].max() < 0.8
    seen = overlaps(matted(images)[1], true)
    assert seen.mean() > 0.96 and seen.min() > 0.93


def test_how_sure_follows_how_right():
    """A body in the colours of what is behind it is not cut out, and that is said."""
    images, true = filmed(1, RESTING, textured(1))
    faint = textured(1) + 0.12 * (images - textured(1))
    noise = NOISE * np.random.default_rng(7).standard_normal(images.shape)
    _, solid, sure = matted(np.clip(faint + noise, 0.0, 1.0).astype(np.float32))
    assert overlaps(solid, true).mean() < 0.7 and np.mean(sure) < 0.9


def test_nothing_moves():
    still = np.repeat(textured(0)[None], 6, axis=0)
    assert still_background(Footage(lambda: iter(still))) is None


def test_other_views_contradict_a_ghost():
    """One view holds a place for the object where the others see none, and misses a part of it that they see."""
    moments = np.arange(8.0)
    masks = np.stack([film(view, moments)[..., 3] > 0.5 for view in range(VIEWS)])
    spoilt = masks.copy()
    spoilt[2, :, 70:85, 10:30] = True
    column = int(np.nonzero(masks[2, 0])[1].mean())
    spoilt[2, 0, :, column:] = False
    views = [View(0, "", intrinsic(), pose, np.ones((SIZE, SIZE), bool), None) for pose in rig()]
    cameras = [Silhouettes(view, moments, mask) for view, mask in zip(views, spoilt, strict=True)]
    expected = expectations(cameras, START)
    assert all(one is not None for one in expected)
    for one, mask in zip(expected, masks, strict=True):
        assert (one.loose[mask] > -UNSURE).mean() > 0.99
    assert expected[2].log_odds(3)[75:80, 15:25].max() < -3.0
    assert overlaps(expected[2].depth > 0.0, masks[2]).min() > 0.5
    assert expectations(cameras[:3], START) == [None] * 3


def test_videos_of_a_body_that_comes_back(tmp_path):
    """Six compressed videos without plates: init refused them, as in some views the body hid its own background."""
    source, calibration = tmp_path / "drop", {}
    true = []
    for view, (rotation, translation) in enumerate(World(unit=0.001).opencv()):
        images, outlines = filmed(view, BOUNCE, textured(view))
        true.append(outlines)
        save_video(source / f"cam{view}.mp4", images)
        calibration[f"cam{view}"] = {"K": opencv_intrinsic().tolist(), "dist": [0.0] * 5}
        calibration[f"cam{view}"] |= {"R": rotation.tolist(), "t": translation.tolist()}
    write_json(source / "calibration.json", calibration)
    assert main(["init", str(source), str(tmp_path / "scene"), "--up", "y"]) == 0
    found = [
        [read_png(tmp_path / "scene" / "data" / f"m_{view}_{frame}.png")[..., 3] > 0.5 for frame in range(len(BOUNCE))]
        for view in range(VIEWS)
    ]
    seen = overlaps(np.array(found), np.stack(true))
    assert seen.mean() > 0.93 and seen.min() > 0.85
    assert "and the other views, in all cameras; overlap (IoU) expected" in (tmp_path / "scene/scene.yaml").read_text()
