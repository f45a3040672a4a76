"""Wrong recordings as a new user would give them: each is one line that names what, where and the remedy."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from PIL import Image

from pacnerf_lpo.__main__ import main
from tests.data.recordings.layouts import write_json
from tests.data.recordings.studio import (
    FISHEYE,
    FRAMES,
    NAMES,
    SIZE,
    SOFT,
    VIEWS,
    background,
    films,
    raw,
    save,
    save_video,
)

pytestmark = pytest.mark.slow


class Wrong(NamedTuple):
    """A layout, what is done to its folder, words of the line that has to come, the options of ``init``, and whether
    the line is a warning: what a right recording could be, too, is doubted, not refused.
    """

    layout: str
    change: Callable[[Path], object]
    said: tuple[str, ...]
    options: tuple[str, ...] = ()
    doubted: bool = False


def calibrated(change: Callable[[dict], object]) -> Callable[[Path], None]:
    """Change the shared OpenCV calibration."""

    def apply(folder: Path) -> None:
        path = folder / "calibration.json"
        cameras = json.loads(path.read_text())
        change(cameras)
        write_json(path, cameras)

    return apply


def every(**changes: Callable[[dict], object]) -> Callable[[Path], None]:
    """Change one value of every camera, given the camera."""

    def apply(cameras: dict) -> None:
        for camera in cameras.values():
            for key, value in changes.items():
                camera[key] = np.array(value(camera)).tolist()

    return calibrated(apply)


def frames(view: int, change: Callable[[int], np.ndarray], masks: bool = False) -> Callable[[Path], None]:
    """Exchange the images, or the masks, of one camera with folders of images."""

    def apply(folder: Path) -> None:
        place = folder / "masks" / NAMES[view] if masks else folder / NAMES[view]
        for frame in range(FRAMES):
            save(place / f"{frame}.png", change(frame))

    return apply


def all_masks(change: Callable[[int, int], np.ndarray]) -> Callable[[Path], None]:
    return lambda folder: [frames(view, lambda f, v=view: change(v, f), masks=True)(folder) for view in range(VIEWS)]


def transforms(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Change every pose of nerfstudio's file [(4, 4)]."""

    def apply(folder: Path) -> None:
        values = json.loads((folder / "transforms.json").read_text())
        for frame in values["frames"]:
            frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()
        write_json(folder / "transforms.json", values)

    return apply


def other_rig(cameras: dict) -> None:
    """The calibration of a rig that stood elsewhere, with the same names."""
    poses = np.random.default_rng(5).permutation(list(cameras))
    taken = {name: (cameras[other]["R"], cameras[other]["t"]) for name, other in zip(cameras, poses, strict=True)}
    for name, (rotation, translation) in taken.items():
        cameras[name].update(R=rotation, t=translation)


def mask(view: int, frame: int) -> np.ndarray:
    return films(FISHEYE)[view, frame, ..., 3]


def position_for_translation(camera: dict) -> np.ndarray:
    return -np.array(camera["R"]).T @ camera["t"]


def swapped_intrinsics(camera: dict) -> np.ndarray:
    """fx, cx, fy, cy read as fx, fy, cx, cy."""
    (fx, _, cx), (_, fy, cy), _ = camera["K"]
    return np.array([[fx, 0, fy], [0, cx, cy], [0, 0, 1]])


def shifted_images(folder: Path) -> None:
    """The camera door looks past the object: it is cut off from the first frame to the last."""
    save_video(folder / "door.mp4", np.roll(raw(SOFT)[5], SIZE // 2, axis=2))


def nowhere(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_text("a file")


def zipped(folder: Path) -> None:
    shutil.make_archive(str(folder), "zip", folder)
    shutil.rmtree(folder)
    folder.with_suffix(".zip").rename(folder)


def narrow(cameras: dict) -> None:
    """All cameras in one place, but for a millimetre."""
    first = dict(cameras["left"])
    for number, camera in enumerate(cameras.values()):
        camera.update(R=first["R"], t=[value + number for value in first["t"]])


CASES = {
    "a file for a folder": Wrong("opencv_shared", nowhere, ("is a file", "give the folder")),
    "calibration is no JSON": Wrong(
        "opencv_shared", lambda f: (f / "calibration.json").write_text("{"), ("calibration.json: cannot be read",)
    ),
    "calibration is empty": Wrong("opencv_shared", lambda f: write_json(f / "calibration.json", {}), ("0 camera",)),
    "calibration of another rig": Wrong("opencv_plates", calibrated(other_rig), ("do not belong to one body",)),
    "NaN in the calibration": Wrong("opencv_shared", every(t=lambda c: [np.nan, 0, 0]), ("NaN or infinity",)),
    "zero focal length": Wrong(
        "opencv_shared", every(K=lambda c: np.array(c["K"]) * [[0], [1], [1]]), ("positive fx and fy",)
    ),
    "intrinsics in another order": Wrong("opencv_plates", every(K=swapped_intrinsics), ("intrinsics",)),
    "focal length twice too long": Wrong(
        "opencv_plates",
        every(K=lambda c: np.array(c["K"]) * [[2, 1, 1], [1, 2, 1], [1, 1, 1]]),
        ("the body falls at", "focal lengths"),
        doubted=True,
    ),
    "distortion that folds the image": Wrong(
        "opencv_shared", every(dist=lambda c: [-8.0, 0, 0, 0, 0]), ("distortion coefficients", "order")
    ),
    "distortion of absurd size": Wrong("opencv_plates", every(dist=lambda c: [40.0, 0, 0, 0, 0]), ("its lens",)),
    "rotation vector in degrees": Wrong(
        "opencv_shared",
        every(R=lambda c: np.degrees(cv2.Rodrigues(np.array(c["R"]))[0].ravel())),
        ("rotation", "degrees"),
    ),
    "camera position for translation": Wrong(
        "opencv_plates", every(t=position_for_translation), ("do not belong to one body",)
    ),
    "translation in metres, else millimetres": Wrong(
        "opencv_plates", calibrated(lambda c: c["top"].update(t=(np.array(c["top"]["t"]) / 1000).tolist())), ("top",)
    ),
    "a camera twice": Wrong(
        "opencv_shared", calibrated(lambda c: c["top"].update(R=c["left"]["R"], t=c["left"]["t"])), ("stands exactly",)
    ),
    "the same video twice": Wrong(
        "opencv_shared", lambda f: shutil.copy(f / "left.mp4", f / "top.mp4"), ("the same images",)
    ),
    "all cameras in one place": Wrong("opencv_plates", calibrated(narrow), ("cameras show meets behind them",)),
    "nerfstudio with OpenCV's axes": Wrong(
        "nerfstudio", transforms(lambda m: m * [[1, -1, -1, 1]]), ("behind", "OpenGL")
    ),
    "nerfstudio with world-to-camera poses": Wrong("nerfstudio", transforms(np.linalg.inv), ("world to camera",)),
    "nerfstudio mirrored": Wrong("nerfstudio", transforms(lambda m: np.diag([-1, 1, 1, 1]) @ m), ("mirrored",)),
    "a frame without its image": Wrong(
        "nerfstudio", lambda f: next((f / "images" / "top").iterdir()).unlink(), ("the image is missing",)
    ),
    "unit a thousand times too large": Wrong("opencv_plates", lambda f: None, ("m/s^2", "--unit"), ("--unit", "1")),
    "unit a thousand times too small": Wrong("caliscope", lambda f: None, ("m/s^2", "--unit"), ("--unit", "mm")),
    "no unit": Wrong("opencv_shared", lambda f: None, ("--unit", "metres one unit is"), ("--unit", "feet")),
    "another axis up": Wrong("opencv_plates", lambda f: None, ("up direction", "--up"), ("--up", "x")),
    "ground above the object": Wrong(
        "opencv_plates", lambda f: None, ("ground", "--ground"), ("--ground", "2500", "--unit", "mm")
    ),
    "ground far below": Wrong("opencv_plates", lambda f: None, ("ground", "--ground"), ("--ground", "-5000")),
    "a normal of length zero": Wrong(
        "opencv_shared", lambda f: None, ("--ground_normal",), ("--ground_normal=[0,0,0]",)
    ),
    "ground on end": Wrong("opencv_plates", lambda f: None, ("ground",), ("--ground_normal", "1", "-0.1", "0")),
    "no density": Wrong("opencv_shared", lambda f: None, ("--density 0", "kg/m^3"), ("--density", "0")),
    "negative gravity": Wrong("opencv_shared", lambda f: None, ("--gravity",), ("--gravity", "-9.81")),
    "gravity of the moon": Wrong(
        "opencv_plates", lambda f: None, ("m/s^2", "--gravity"), ("--gravity", "1.62", "--unit", "mm")
    ),
    "fps 0": Wrong("opencv_shared", lambda f: None, ("--fps 0",), ("--fps", "0")),
    "fps five times too large": Wrong("phystwin", lambda f: None, ("--fps",), ("--fps", "120")),
    "a video of no bytes": Wrong("opencv_shared", lambda f: (f / "top.mp4").write_bytes(b""), ("top.mp4", "damaged")),
    "a video of one frame": Wrong(
        "opencv_shared", lambda f: save_video(f / "top.mp4", raw(SOFT)[4, :1]), ("camera top", "1 frame")
    ),
    "a text file for an image": Wrong(
        "opencv_each", lambda f: (f / "top" / "3.png").write_text("text"), ("3.png", "cannot be read"), ("--fps", "24")
    ),
    "images of another resolution": Wrong(
        "opencv_shared",
        lambda f: save_video(f / "top.mp4", raw(SOFT)[4][:, ::2, ::2]),
        (f"{SIZE // 2} x {SIZE // 2}", "calibrated for"),
    ),
    "one image of another size": Wrong(
        "opencv_each",
        lambda f: Image.open(f / "top" / "3.png").resize((80, 80)).save(f / "top" / "3.png"),
        ("3.png", "one size"),
        ("--fps", "24"),
    ),
    "a video turned by ninety degrees": Wrong(
        "opencv_shared", lambda f: save_video(f / "left.mp4", raw(SOFT)[0].swapaxes(1, 2)[:, ::-1]), ("left",)
    ),
    "a mirrored video": Wrong(
        "opencv_shared", lambda f: save_video(f / "left.mp4", raw(SOFT)[0][:, :, ::-1]), ("left",)
    ),
    "all videos mirrored": Wrong(
        "opencv_shared",
        lambda f: [save_video(f / f"{name}.mp4", raw(SOFT)[v][:, :, ::-1]) for v, name in enumerate(NAMES)],
        ("do not belong to one body",),
    ),
    "masks all empty": Wrong(
        "opencv_each", all_masks(lambda v, f: np.zeros((SIZE, SIZE))), ("no object is found",), ("--fps", "24")
    ),
    "masks all full": Wrong(
        "opencv_each", all_masks(lambda v, f: np.ones((SIZE, SIZE))), ("invert the masks",), ("--fps", "24")
    ),
    "masks inverted": Wrong(
        "opencv_each", all_masks(lambda v, f: 1.0 - mask(v, f)), ("invert the masks",), ("--fps", "24")
    ),
    "masks of another camera": Wrong(
        "opencv_each", frames(2, lambda f: mask(3, f), masks=True), ("front",), ("--fps", "24")
    ),
    "masks of another size": Wrong(
        "opencv_each", frames(2, lambda f: mask(2, f)[::2, ::2], masks=True), ("not of the size",), ("--fps", "24")
    ),
    "masks that are 0 and 1, not 0 and 255": Wrong(
        "opencv_each", all_masks(lambda v, f: mask(v, f) / 255.0), ("no object is found",), ("--fps", "24")
    ),
    "no motion in any video": Wrong(
        "opencv_shared",
        lambda f: [save_video(f / f"{n}.mp4", np.repeat(raw(SOFT)[v, :1], 9, 0)) for v, n in enumerate(NAMES)],
        ("nothing moves",),
    ),
    "the object lies still, masked": Wrong(
        "opencv_each",
        lambda f: [
            frames(v, lambda _, v=v: films(FISHEYE)[v, 10, ..., :3])(f)
            or frames(v, lambda _, v=v: mask(v, 10), True)(f)
            for v in range(VIEWS)
        ],
        ("is not seen to fall",),
        ("--fps", "24"),
    ),
    "no contact": Wrong(
        "opencv_each",
        lambda f: [path.unlink() for path in f.rglob("*.png") if path.stem.isdigit() and int(path.stem) > 4],
        ("is not seen to fall onto a ground",),
        ("--fps", "24"),
    ),
    "the video begins after the contact": Wrong(
        "opencv_each",
        lambda f: [path.unlink() for path in f.rglob("*.png") if path.stem.isdigit() and int(path.stem) < 7],
        ("hardly falls", "--up"),
        ("--fps", "24"),
    ),
    "a single view": Wrong(
        "opencv_shared", lambda f: None, ("1 camera",), ("--leave_out", *(name for name in NAMES if name != "top"))
    ),
    "the object beside the image": Wrong("opencv_shared", shifted_images, ("door",)),
    "a plate of another camera": Wrong(
        "anipose", lambda f: save(f / "backgrounds" / "left.png", background(3)), ("left",)
    ),
    "an archive for a folder": Wrong("opencv_shared", zipped, ("is a file", "unpack")),
    "masks in a folder of another name": Wrong(
        "opencv_each",
        lambda f: (f / "masks").rename(f / "mask"),
        ("not read: mask", "masks/CAMERA/"),
        ("--fps", "24"),
        doubted=True,
    ),
    "masks of a camera that there is not": Wrong(
        "opencv_each",
        lambda f: (f / "masks" / "top").rename(f / "masks" / "cam_top"),
        ("not read: masks/cam_top", "top"),
        ("--fps", "24"),
        doubted=True,
    ),
    "plates in a folder of another name": Wrong(
        "anipose",
        lambda f: (f / "backgrounds").rename(f / "background"),
        ("not read: background", "backgrounds/CAMERA.png"),
        doubted=True,
    ),
    "plates that show the object": Wrong(
        "anipose",
        lambda f: [save(f / "backgrounds" / f"{n}.png", raw(SOFT)[v, 0]) for v, n in enumerate(NAMES)],
        ("no object is found", "background plate"),
    ),
    "a video upside down": Wrong(
        "opencv_shared", lambda f: save_video(f / "left.mp4", raw(SOFT)[0][:, ::-1, ::-1]), ("camera left",)
    ),
    "all videos backwards": Wrong(
        "opencv_shared",
        lambda f: [save_video(f / f"{n}.mp4", raw(SOFT)[v][::-1]) for v, n in enumerate(NAMES)],
        ("hardly falls", "--up"),
    ),
    "a rotation as a quaternion": Wrong(
        "opencv_shared", every(R=lambda c: [1, 0, 0, 0]), ("rotation", "expected 3 x 3 or 9 or 3 numbers")
    ),
    "two throws in a video": Wrong(
        "opencv_shared",
        lambda f: [save_video(f / f"{n}.mp4", np.concatenate([raw(SOFT)[v]] * 2)) for v, n in enumerate(NAMES)],
        ("several throws in one video", f"cut all videos before frame {FRAMES}"),
        doubted=True,
    ),
    "two layouts at once": Wrong("dynerf", lambda f: write_json(f / "transforms.json", {}), ("--format",)),
}


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_input_is_named(write, capsys, caplog, case):
    wrong = CASES[case]
    source = write(wrong.layout)
    wrong.change(source)
    scene = source.parent / "scene"
    assert main(["init", str(source), str(scene), *wrong.options]) == (0 if wrong.doubted else 2)
    printed = capsys.readouterr()
    lines = [*caplog.messages, *printed.out.splitlines()] if wrong.doubted else printed.err.strip().splitlines()[-1:]
    assert any(all(word in line for word in wrong.said) for line in lines), lines
    assert scene.exists() == wrong.doubted


def test_a_folder_that_cannot_be_written(write, capsys):
    assert main(["init", str(write("opencv_shared")), "/proc/scene"]) == 2
    assert "/proc/scene: cannot be written" in capsys.readouterr().err


def test_there_are_fifty():
    assert len(CASES) >= 50
