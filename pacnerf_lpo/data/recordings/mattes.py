"""Undistorted, matted images of a camera: transparent where the object is not."""

from collections.abc import Callable, Iterator

import numpy as np

from pacnerf_lpo.data.images import on_white, read_png
from pacnerf_lpo.data.matting import matte
from pacnerf_lpo.data.recordings.background import (
    Background,
    background_by_views,
    expected_overlap,
    solid_part,
    still_background,
)
from pacnerf_lpo.data.recordings.colours import Colours
from pacnerf_lpo.data.recordings.footage import Footage, reduced
from pacnerf_lpo.data.recordings.media import library, read_frames
from pacnerf_lpo.data.recordings.other_views import Expectation
from pacnerf_lpo.data.recordings.recording import Camera, Frame, check_images
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.heartbeat import doing

WHITE = 1.0 - 1.5 / 255.0
"""From here on a value counts as pure white."""
INVERTED = 0.5
"""A mask that is bright along more of the image border than this marks the background."""


class Lens:
    """Takes images of a camera to those of a pinhole with the same focal lengths and principal point.

    valid: False where no pixel of the original falls [(H, W), bool]
    """

    def __init__(self, camera: Camera, size: tuple[int, int]):
        self.maps, self.valid = None, np.ones(size[::-1], bool)
        if not camera.lens.distorts:
            return
        self.cv2 = library("cv2", f"camera {camera.name}: undistorting images")
        intrinsic = camera.intrinsic.copy()
        intrinsic[:2, 2] -= 0.5
        undistort = self.cv2.fisheye if camera.lens.model == "fisheye" else self.cv2
        self.maps = undistort.initUndistortRectifyMap(
            intrinsic, np.array(camera.lens.coefficients), np.eye(3), intrinsic, size, self.cv2.CV_32FC1
        )
        x, y = self.maps
        self.valid = (x >= -0.5) & (x <= size[0] - 0.5) & (y >= -0.5) & (y <= size[1] - 0.5)

    def undistorted(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels [0..1, (H, W, C)] at their undistorted places; what was outside repeats the border."""
        if self.maps is None:
            return pixels
        moved = self.cv2.remap(pixels, *self.maps, self.cv2.INTER_LINEAR, borderMode=self.cv2.BORDER_REPLICATE)
        return moved.reshape(*moved.shape[:2], -1)


class Mattes:
    """The images of a camera, one after the other.

    From masks where there are any; else from transparency; else by white around the object; else by the background,
    which is a plate or comes from the video itself.

    lens: as it undistorts. plate: the background, undistorted [0..1, (H, W, 3)]; None where none was needed.
    way: how the mattes were made, in words. still: what was found in a video without a plate.
    expected: what the other views say about this camera. compared: whether these were asked.
    overlaps: intersection over union that each frame's matte is expected to have with the truth, 1 where it is given
    [(F,)]. masks: where the object is, as far as the frames were matted [(F, h, w), bool, reduced].
    """

    def __init__(self, camera: Camera):
        self.camera = camera
        first = next(read_frames(camera.frames[:1]))
        self.size = first.shape[1], first.shape[0]
        check_images(camera, self.size)
        self.lens = Lens(camera, self.size)
        self.plate: np.ndarray | None = None
        self.still: Background | None = None
        self.expected: Expectation | None = None
        self.compared, self.overlaps = False, np.ones(len(camera.frames))
        self.masks = np.zeros((len(camera.frames), *reduced(self.lens.valid).shape), bool)
        self.cut: Callable[[np.ndarray, np.ndarray | None, int], np.ndarray]
        border = np.concatenate((first[0], first[-1], first[:, 0], first[:, -1]))
        if camera.frames[0].mask is not None:
            self.way, self.cut = "masks", self._by_mask
        elif first.shape[-1] == 4:
            self.way, self.cut = "transparency", lambda pixels, *_: self.lens.undistorted(pixels)
        elif camera.on_white or border.min() > WHITE:
            self.way = "white around the object"
            self.cut = lambda pixels, *_: np.dstack(on_white(self.lens.undistorted(pixels[..., :3])))
        elif camera.plate is None:
            self.way, self.cut = "background of the video", self._by_video
            self.find_background()
        else:
            background = read_png(camera.plate)[..., :3]
            if background.shape[1::-1] != self.size:
                raise UserInputError(
                    f"{camera.plate}: not of the size of the images of camera {camera.name}; make them one size"
                )
            plate = self.plate = self.lens.undistorted(background)
            self.way = "background plate"
            self.cut = lambda pixels, *_: _unmixed(*matte(self.lens.undistorted(pixels[..., :3]), plate))

    @property
    def described(self) -> str:
        """How the mattes were made, in words."""
        return f"{self.way} and the other views" if self.still is not None and self.compared else self.way

    def find_background(self) -> None:
        """Find the background in the video, for all mattes from now on; UserInputError where nothing moves."""
        camera = self.camera
        doing(f"finding the background of camera {camera.name}")
        self.footage = Footage(lambda: (self.lens.undistorted(pixels[..., :3]) for _, pixels in self._frames()))
        self.still = still_background(self.footage)
        if self.still is None:
            raise UserInputError(
                f"{camera.frames[0].file}: nothing moves in camera {camera.name}; give masks, or an image of the empty "
                f"background as backgrounds/{camera.name}.png"
            )
        self.enlarge_background()
        doing("matting the videos")

    def correct(self, expected: Expectation, colours: Colours) -> None:
        """Find the background and ``masks`` again with what the other views say about all frames, at reduced size."""
        self.masks = self.masks.copy()
        self.expected, self.still = expected, background_by_views(self.footage, expected, self.masks, colours)
        for number, image in enumerate(self.footage):
            self.masks[number] = self._cut(image, number)[1] > 0.5

    def enlarge_background(self) -> None:
        """Bring the background that was found at reduced size to all pixels, as frames are matted by it."""
        if self.still is not None:
            self.still = self.still.at_full_size(self.footage)
            self.plate = self.still.plate

    def __iter__(self) -> Iterator[np.ndarray]:
        """Colour and opacity of every frame, undistorted [0..1, (H, W, 4)]."""
        for number, (frame, pixels) in enumerate(self._frames()):
            mask = None if frame.mask is None else read_png(frame.mask)
            if mask is not None and mask.shape[:2] != pixels.shape[:2]:
                raise UserInputError(f"{frame.mask}: not of the size of {frame.file.name}; make them one size")
            result = self.cut(pixels, mask, number)
            result[..., 3] *= self.lens.valid
            self.masks[number] = reduced(result[..., 3]) > 0.5
            yield result

    def _frames(self) -> Iterator[tuple[Frame, np.ndarray]]:
        for frame, pixels in zip(self.camera.frames, read_frames(self.camera.frames), strict=True):
            if pixels.shape[1::-1] != self.size:
                raise UserInputError(
                    f"{frame.file}: {pixels.shape[1]} x {pixels.shape[0]} pixels, but the first image of camera "
                    f"{self.camera.name} has {self.size[0]} x {self.size[1]}; make them one size"
                )
            yield frame, pixels

    def _by_mask(self, pixels: np.ndarray, mask: np.ndarray | None, _: int) -> np.ndarray:
        if mask is None:
            raise UserInputError(
                f"camera {self.camera.name}: some frames have a mask and some have not; give all or none"
            )
        opacity = mask[..., 3] if mask.shape[-1] == 4 and mask[..., 3].min() < 1.0 else mask[..., :3].max(axis=-1)
        edge = np.concatenate((opacity[0], opacity[-1], opacity[:, 0], opacity[:, -1]))
        if (edge > 0.5).mean() > INVERTED:
            name = self.camera.frames[0].mask
            raise UserInputError(f"{name}: bright along the image border, so it marks the background; invert the masks")
        return self.lens.undistorted(np.dstack((pixels[..., :3], opacity)).astype(np.float32))

    def _by_video(self, pixels: np.ndarray, _: np.ndarray | None, number: int) -> np.ndarray:
        return _unmixed(*self._cut(self.lens.undistorted(pixels[..., :3]), number))

    def _cut(self, image: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Matte a frame, or a reduced one where the background is reduced."""
        assert self.still is not None
        expected = 0.0 if self.expected is None else self.expected.log_odds(number, image.shape)
        odds = self.still.denoised_odds(image, expected)
        solid = solid_part(odds)
        self.overlaps[number] = expected_overlap(odds, solid)
        return matte(image, self.still.plate, solid)


def _unmixed(colour: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    """The object's own colour and its opacity [(H, W, 4)] from its colour on white [0..1, (H, W, 3)]."""
    own = (colour - (1.0 - opacity[..., None])) / np.maximum(opacity[..., None], 1e-3)
    return np.dstack((np.clip(own, 0.0, 1.0), opacity)).astype(np.float32)
