"""Path-traces the images of a recording with Mitsuba 3 (Jakob et al. 2022), and the exact outlines of its body.

It runs in a Python that has Mitsuba, see ``mattes.py``, and needs nothing of this package:

    python validation/path_traced.py FOLDER

FOLDER holds ``scene.json`` and ``surface.npz`` as ``mattes.py`` writes them; images that are there already are kept.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

ROOM = 4.0
"""Half the edge of the floor, and where the walls stand [m]."""
SAMPLES, DEPTH = 32, 5
"""Paths per pixel, few enough to leave noise, and their length: light that the floor throws onto the body is there."""
EXACT = 64
"""Rays per pixel of an outline."""
LAMP, GLOW = 24.0, 0.6
"""Radiance of the lamp, a metre wide and three metres up, and of the surroundings."""


def perspective(pose: np.ndarray, intrinsic: np.ndarray, size: int, samples: int) -> dict:
    """A camera, OpenGL pose (3, 4) and square pixels (3, 3) with the principal point in the middle."""
    towards = np.eye(4)
    towards[:3] = pose * [-1.0, 1.0, -1.0, 1.0]  # Mitsuba looks along +z with x to the left
    return {
        "type": "perspective",
        "fov": float(np.degrees(2.0 * np.arctan(0.5 * size / intrinsic[0, 0]))),
        "to_world": mi.ScalarTransform4f(towards),
        "film": {
            "type": "hdrfilm",
            "width": size,
            "height": size,
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }


def textured(texture: np.ndarray, repeats: float) -> dict:
    """A matt surface with a texture [0..1, sRGB, (H, W, 3)]."""
    bitmap = mi.Bitmap(np.ascontiguousarray(np.round(255 * texture).astype(np.uint8)))
    return {
        "type": "twosided",
        "material": {
            "type": "diffuse",
            "reflectance": {
                "type": "bitmap",
                "bitmap": bitmap,
                "to_uv": mi.ScalarTransform3f().scale([repeats, repeats]),
            },
        },
    }


def room(floor: dict, wall: dict) -> dict:
    """Floor y = 0, four walls, a lamp and light from all around."""
    to = mi.ScalarTransform4f
    shapes = {"floor": {"type": "rectangle", "to_world": to().rotate([1, 0, 0], -90).scale(ROOM), "bsdf": floor}}
    for number in range(4):
        turn = to().rotate([0, 1, 0], 90 * number)
        shapes[f"wall_{number}"] = {
            "type": "rectangle",
            "to_world": turn @ to().translate([0, 0, -ROOM]).scale(ROOM),
            "bsdf": wall,
        }
    lamp = {"type": "area", "radiance": {"type": "rgb", "value": LAMP}}
    place = to().look_at(origin=[1.1, 3.2, 0.8], target=[0, 0, 0], up=[0, 0, 1]).scale(0.5)
    shapes["lamp"] = {"type": "rectangle", "to_world": place, "emitter": lamp}
    shapes["glow"] = {"type": "constant", "radiance": {"type": "rgb", "value": GLOW}}
    return shapes


def body(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, material: dict) -> mi.Mesh:
    """A triangle mesh [m, (V, 3)] with colours at its vertices [linear light, (V, 3)]."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(material)
    mesh = mi.Mesh("body", len(vertices), len(faces), props=properties, has_vertex_normals=True)
    mesh.add_attribute("vertex_color", 3, colours.astype(np.float32).ravel())
    values = mi.traverse(mesh)
    values["vertex_positions"] = vertices.astype(np.float32).ravel()
    values["faces"] = faces.astype(np.uint32).ravel()
    values.update()
    mesh.recompute_vertex_normals()
    return mesh


def glowing(vertices: np.ndarray, faces: np.ndarray, folder: Path) -> dict:
    """The same mesh as the only light, by way of a file."""
    mesh = mi.Mesh("glowing", len(vertices), len(faces))
    values = mi.traverse(mesh)
    values["vertex_positions"] = vertices.astype(np.float32).ravel()
    values["faces"] = faces.astype(np.uint32).ravel()
    values.update()
    path = folder / "glowing.ply"
    mesh.write_ply(str(path))
    return {
        "type": "ply",
        "filename": str(path),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
    }


def main(folder: Path) -> None:
    """Write ``images/CAMERA_FRAME.png`` and, as the covered part of each pixel, ``truth/CAMERA_FRAME.png``."""
    scene = json.loads((folder / "scene.json").read_text())
    surface = np.load(folder / "surface.npz")
    size, faces, colours = scene["size"], surface["faces"], surface["colours"]
    floor, wall = (textured(surface[name], scene["repeats"]) for name in ("floor", "wall"))
    skin = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    ground = {"type": "rectangle", "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(ROOM), "bsdf": black}
    for name in ("images", "truth"):
        (folder / name).mkdir(exist_ok=True)
    for frame, vertices in enumerate(surface["vertices"]):
        lit = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": DEPTH},
                **room(floor, wall),
                "body": body(vertices, faces, colours, skin),
            }
        )
        alone = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 1},
                "ground": ground,
                "body": glowing(vertices, faces, folder),
            }
        )
        for view, (pose, intrinsic) in enumerate(zip(scene["poses"], scene["intrinsics"], strict=True)):
            path = folder / "images" / f"{view}_{frame}.png"
            if path.is_file():
                continue
            camera = np.array(pose), np.array(intrinsic), size
            covered = mi.render(alone, sensor=mi.load_dict(perspective(*camera, EXACT)), seed=1)
            mi.util.write_bitmap(str(folder / "truth" / path.name), mi.Bitmap(covered), write_async=False)
            seed = 1 + frame + 1000 * view
            seen = mi.render(lit, sensor=mi.load_dict(perspective(*camera, SAMPLES)), seed=seed)
            mi.util.write_bitmap(str(path), seen, write_async=False)
        print(f"frame {frame + 1} of {len(surface['vertices'])}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
