"""The scene of the studio, written in every layout exactly as its makers write it."""

from __future__ import annotations

import json
import pickle
import struct
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pacnerf_lpo.data.recordings.recording import Lens
from tests.data.recordings.studio import (
    FISHEYE,
    FPS,
    FRAMES,
    NAMES,
    PINHOLE,
    SIZE,
    SOFT,
    TILTED,
    VIEWS,
    X_DOWN,
    Z_DOWN,
    Z_UP,
    World,
    background,
    centred,
    films,
    intrinsic,
    opencv_intrinsic,
    raw,
    save,
    save_video,
)


def write_json(path: Path, values) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(values))


def matrix4(pose: np.ndarray) -> list:
    return [*pose.tolist(), [0.0, 0.0, 0.0, 1.0]]


def pac_nerf(root: Path) -> World:
    """Raw images with plates; the layout is in metres, y up."""
    world, entries = World(), []
    for view, pose in enumerate(world.poses()):
        save(root / f"data/r_{view}_-1.png", background(view))
        for frame in range(FRAMES):
            save(root / f"data/r_{view}_{frame}.png", raw()[view, frame])
        entries += [
            {
                "file_path": f"./data/r_{view}_{f}.png",
                "c2w": pose.tolist(),
                "intrinsic": intrinsic().tolist(),
                "time": f / FPS,
            }
            for f in range(-1, FRAMES)
        ]
    write_json(root / "all_data.json", entries)
    return world


def gic(root: Path) -> World:
    world = pac_nerf(root)
    frames = []
    for view, pose in enumerate(world.poses()):
        for f in range(FRAMES):
            film = films()[view, f]
            save(root / f"data/a_{view}_{f}.png", film)
            save(root / f"data/m_{view}_{f}.png", film[..., :3] * film[..., 3:] + 1.0 - film[..., 3:])
            frames.append(
                {
                    "file_path": f"./data/a_{view}_{f}",
                    "rotation": 0.0,
                    "time": f / FPS,
                    "transform_matrix": matrix4(pose),
                }
            )
    angle = 2.0 * np.arctan(0.5 * SIZE / intrinsic()[0, 0])
    for split in ("train", "val", "test"):
        write_json(root / f"transforms_{split}.json", {"camera_angle_x": angle, "frames": frames})
    return world


def spring_gaus_synthetic(root: Path) -> World:
    """Another unit, and the ground not at zero."""
    world = World(origin=(0.1, 0.3, 0.2), unit=0.4)
    folder = root / "render" / "torus"
    cameras = []
    for view, pose in enumerate(world.poses()):
        cameras.append({"camera": NAMES[view], "K": intrinsic().tolist(), "c2w": matrix4(pose)})
        for f in range(FRAMES):
            save(folder / NAMES[view] / f"{f:03}.png", films()[view, f])
    write_json(folder / "camera.json", cameras)
    write_json(folder / "frame.json", list(range(FRAMES)))
    return world


def spring_gaus_real(root: Path) -> World:
    """Gravity along +z, 120 images a second, of which every fifth is listed here: the scene has 24."""
    world = World(turn=Z_DOWN, origin=(0.2, -0.1, 0.5), unit=0.7)
    model = root / "static" / "colmap" / "bun"
    write_colmap(
        model, [("C0.jpg", world.opencv()[0])], centred() * [[3, 1, 3], [1, 3, 3], [1, 1, 1]], 3 * SIZE, text=False
    )
    calibration, sequence = {}, {"hit_frame": 7}
    for view, (rotation, translation) in enumerate(world.opencv()):
        name = f"C{view}"
        calibration[name] = {"rvecs": cv2.Rodrigues(rotation)[0].tolist(), "tvecs": translation[:, None].tolist()}
        sequence[name] = [f"{5 * f:05}.png" for f in range(FRAMES)]
        for f, file in enumerate(sequence[name]):
            save(root / "dynamic/videos_images" / name / file, raw(off_centre=False)[view, f])
            save(root / "dynamic/videos_masks" / name / file, films(off_centre=False)[view, f, ..., 3])
    write_json(root / "dynamic/cameras_calib.json", calibration)
    write_json(root / "dynamic/sync.json", {})
    write_json(root / "dynamic/sequences/bun/0.json", sequence)
    return world


def nerfstudio(root: Path) -> World:
    """z up, an arbitrary scale, a lens, and masks that are no mattes."""
    world = World(turn=Z_UP, origin=(0.3, 0.2, -0.4), unit=1.7, lens=SOFT)
    k, frames = intrinsic(), []
    for view, pose in enumerate(world.poses()):
        for f in range(FRAMES):
            name = f"images/{NAMES[view]}/frame_{f + 1:05}.png"
            save(root / name, films(SOFT)[view, f])
            frames.append(
                {"file_path": name, "transform_matrix": matrix4(pose), "time": f / FPS, "mask_path": "masks/x.png"}
            )
    values = {
        "camera_model": "OPENCV",
        "fl_x": k[0, 0],
        "fl_y": k[1, 1],
        "cx": k[0, 2],
        "cy": k[1, 2],
        "w": SIZE,
        "h": SIZE,
    }
    lens = dict(zip(("k1", "k2", "p1", "p2", "k3"), SOFT.coefficients, strict=True))
    write_json(root / "transforms.json", {**values, **lens, "frames": frames})
    return world


def d_nerf(root: Path) -> World:
    """Times from 0 to 1, a centred principal point, arbitrary axes."""
    world = World(turn=TILTED, origin=(1.0, 0.5, -2.0), unit=0.25)
    angle = 2.0 * np.arctan(0.5 * SIZE / centred()[0, 0])
    frames = []
    for view, pose in enumerate(world.poses()):
        for f in range(FRAMES):
            save(root / f"train/c{view}_{f:03}.png", films(off_centre=False)[view, f])
            entry = {"file_path": f"./train/c{view}_{f:03}", "rotation": 0.01, "time": f / (FRAMES - 1)}
            frames.append({**entry, "transform_matrix": matrix4(pose)})
    write_json(root / "transforms_train.json", {"camera_angle_x": angle, "frames": frames})
    return world


def write_colmap(folder: Path, images: list, k: np.ndarray, size: int, text: bool, lens: Lens = PINHOLE) -> None:
    """cameras and images as COLMAP documents them: quaternion w x y z, translation, world to camera."""
    folder.mkdir(parents=True, exist_ok=True)
    numbers = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *lens.coefficients[:4]]
    model, name = (
        (1, "PINHOLE") if not lens.distorts else (5, "OPENCV_FISHEYE") if lens.model == "fisheye" else (4, "OPENCV")
    )
    rows = []
    for number, (file, (rotation, translation)) in enumerate(images, 1):
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        rows.append((number, (w, x, y, z, *translation), file))
    if text:
        (folder / "cameras.txt").write_text(
            f"# cameras\n1 {name} {size} {size} {' '.join(map(repr, map(float, numbers)))}\n"
        )
        lines = [f"{n} {' '.join(map(repr, map(float, pose)))} 1 {file}\n\n" for n, pose, file in rows]
        (folder / "images.txt").write_text("# images\n" + "".join(lines))
        (folder / "points3D.txt").write_text("")
        return
    count = struct.pack("<Q", 1)
    (folder / "cameras.bin").write_bytes(count + struct.pack(f"<iiQQ{len(numbers)}d", 1, model, size, size, *numbers))
    data = struct.pack("<Q", len(rows))
    for n, pose, file in rows:
        data += struct.pack("<i7di", n, *pose, 1) + file.encode() + b"\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(data)


def colmap_text(root: Path) -> World:
    """Arbitrary axes and scale, folders of images, a fisheye."""
    world = World(turn=TILTED, origin=(2.0, -1.0, 0.5), unit=2.3, lens=FISHEYE)
    images = [(f"{name}/0000.png", pose) for name, pose in zip(NAMES, world.opencv(), strict=True)]
    write_colmap(root / "sparse/0", images, intrinsic(), SIZE, text=True, lens=FISHEYE)
    for view, name in enumerate(NAMES):
        for f in range(FRAMES):
            save(root / "images" / name / f"{f:04}.png", films(FISHEYE)[view, f])
    return world


def colmap_binary(root: Path) -> World:
    """One registered image per video."""
    world = World(turn=TILTED.T, origin=(0.1, 0.2, 3.0), unit=0.6)
    images = [(f"{name}.png", pose) for name, pose in zip(NAMES, world.opencv(), strict=True)]
    write_colmap(root / "sparse/0", images, intrinsic(), SIZE, text=False)
    for view, name in enumerate(NAMES):
        save_video(root / f"{name}.mp4", raw()[view])
    return world


def dynerf(root: Path) -> World:
    world = World(turn=X_DOWN, origin=(0.5, 0.1, 0.2), unit=0.13)
    rows = []
    for view, pose in enumerate(world.poses()):
        right, up, back, centre = pose.T
        columns = np.column_stack((-up, right, back, centre, (SIZE, SIZE, centred()[0, 0])))
        rows.append([*columns.ravel(), 0.1, 10.0])
        save_video(root / f"cam{view:02}.mp4", raw(off_centre=False)[view])
    np.save(root / "poses_bounds.npy", np.array(rows))
    return world


def phystwin(root: Path) -> World:
    """Metres, z down."""
    world = World(turn=Z_DOWN, origin=(0.2, 0.1, -0.3))
    poses = [np.array(matrix4(pose * [1.0, -1.0, -1.0, 1.0])) for pose in world.poses()]
    (root / "calibrate.pkl").write_bytes(pickle.dumps(poses))
    intrinsics = [opencv_intrinsic().tolist()] * VIEWS
    write_json(root / "metadata.json", {"intrinsics": intrinsics, "WH": [SIZE, SIZE], "fps": FPS, "serial_numbers": []})
    for view in range(VIEWS):
        for f in range(FRAMES):
            save(root / "color" / str(view) / f"{f}.png", raw()[view, f])
    return world


def opencv_shared(root: Path) -> World:
    """Six videos in front of a background, one JSON, millimetres, z up, distorted."""
    world = World(turn=Z_UP, origin=(0.4, -0.3, 0.8), unit=0.001, lens=SOFT)
    cameras = {}
    for view, (rotation, translation) in enumerate(world.opencv()):
        cameras[NAMES[view]] = {
            "K": opencv_intrinsic().tolist(),
            "dist": list(SOFT.coefficients),
            "R": rotation.tolist(),
            "t": translation.tolist(),
            "image_width": SIZE,
            "image_height": SIZE,
        }
        save_video(root / f"{NAMES[view]}.mp4", raw(SOFT)[view])
    write_json(root / "calibration.json", cameras)
    return world


def opencv_plates(root: Path) -> World:
    """The same with images of the empty backgrounds, which are read in a third of the time."""
    for view, name in enumerate(NAMES):
        save(root / "backgrounds" / f"{name}.png", background(view))
    return opencv_shared(root)


def opencv_each(root: Path) -> World:
    """One YAML per camera as cv2.FileStorage writes it, folders of images, masks, x down, centimetres, a fisheye."""
    world = World(turn=X_DOWN, origin=(0.1, 0.2, 0.3), unit=0.01, lens=FISHEYE)
    for view, (rotation, translation) in enumerate(world.opencv()):
        storage = cv2.FileStorage(str(root / f"{NAMES[view]}.yml"), cv2.FILE_STORAGE_WRITE)
        storage.write("camera_matrix", opencv_intrinsic())
        storage.write("distortion_coefficients", np.array(FISHEYE.coefficients)[:, None])
        storage.write("rvec", cv2.Rodrigues(rotation)[0])
        storage.write("tvec", translation[:, None])
        storage.write("model", "fisheye")
        storage.release()
        for f in range(FRAMES):
            save(root / NAMES[view] / f"{f}.png", raw(FISHEYE)[view, f])
            save(root / "masks" / NAMES[view] / f"{f}.png", films(FISHEYE)[view, f, ..., 3])
    return world


def anipose(root: Path) -> World:
    """calibration.toml of aniposelib, millimetres, y down as its first camera would have it, plates."""
    world = World(turn=Z_DOWN @ Z_DOWN @ X_DOWN, origin=(0.3, 0.1, 0.6), unit=0.001, lens=SOFT)
    text = ""
    for view, (rotation, translation) in enumerate(world.opencv()):
        text += (
            f'[cam_{view}]\nname = "{NAMES[view]}"\nsize = [{SIZE}, {SIZE}]\nmatrix = {opencv_intrinsic().tolist()}\n'
            f"distortions = {list(SOFT.coefficients)}\nrotation = {cv2.Rodrigues(rotation)[0].ravel().tolist()}\n"
            f"translation = {translation.tolist()}\n\n"
        )
        save_video(root / f"drop-{NAMES[view]}.mp4", raw(SOFT)[view])
        save(root / "backgrounds" / f"{NAMES[view]}.png", background(view))
    (root / "calibration.toml").write_text(text + "[metadata]\nadjusted = false\nerror = 0.4\n")
    return world


def caliscope(root: Path) -> World:
    """camera_array.toml: cameras by port, metres, any axes."""
    world = World(turn=TILTED, origin=(0.0, 0.3, 0.1), lens=SOFT)
    text = ""
    for view, (rotation, translation) in enumerate(world.opencv()):
        text += (
            f"[cameras.{view}]\ncam_id = {view}\nsize = [{SIZE}, {SIZE}]\nrotation_count = 0\nerror = 0.2\n"
            f"matrix = {opencv_intrinsic().tolist()}\ndistortions = {list(SOFT.coefficients)}\n"
            f"rotation = {cv2.Rodrigues(rotation)[0].ravel().tolist()}\ntranslation = {translation.tolist()}\n"
            "fisheye = false\n\n"
        )
        save_video(root / "recordings" / f"cam_{view}.mp4", raw(SOFT)[view])
    (root / "camera_array.toml").write_text(text)
    return world


WRITERS = {
    writer.__name__: writer
    for writer in (
        pac_nerf,
        gic,
        spring_gaus_synthetic,
        spring_gaus_real,
        nerfstudio,
        d_nerf,
        colmap_text,
        colmap_binary,
        dynerf,
        phystwin,
        opencv_shared,
        opencv_each,
        anipose,
        caliscope,
    )
}
