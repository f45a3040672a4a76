"""``scene.html``: shows a person whether a scene is right, one page that opens without network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.look import Look
from pacnerf_lpo.data.recordings.scene_warnings import SceneWarning
from pacnerf_lpo.data.recordings.voxel_hull import hull_picture
from pacnerf_lpo.data.recordings.written_scene import View, picture
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report import overlay
from pacnerf_lpo.report.page import atlas, base64_array, page, parts, plain, quantised, size_within

PAGE_FILE = "scene.html"
STYLES = ("report.css", "scene.css")
SCRIPTS = ("base.js", "charts.js", "space.js", "scene.js")
INSIDE = 0.98
"""Share of a matte that the hull covers, from which on the two agree up to the hull's cells."""
IMAGE_BUDGET = 4_500_000
LADDER = ((1280, 80), (960, 78), (720, 75), (540, 70), (400, 60))
"""Longest side [pixels] and quality of the images, of which the first that fits the budget is taken."""
MOST_POINTS = 8000
FRUSTUM = 0.18
"""Length of a drawn camera, relative to its distance from the body."""


def write_scene_page(look: Look, warnings: Sequence[SceneWarning]) -> Path:
    """Write ``scene.html`` next to scene.yaml; returns its path."""
    scene = look.scene
    name = scene.folder.resolve().name
    text = page(
        "scene",
        f"{name}: is the scene right?",
        STYLES,
        SCRIPTS,
        {"space": space_data(look), "height": height_data(look)},
        folder=name,
        source=f"from {scene.source}, layout {scene.layout}" if scene.source else "a scene",
        found=found_sentence(look),
        facts=facts(look),
        warnings=warnings,
        layers={**overlay.LAYERS, "grid": f"ground, squares of {_ground(look)[1]:g} m"},
        cameras=cameras(look, warnings),
        fall=fall_sentence(look),
        all_values=scene.values,
    )
    path = scene.folder / PAGE_FILE
    write_atomically(path, text.encode())
    return path


def found_sentence(look: Look) -> str:
    """What was found, in one sentence."""
    scene, rate = look.scene, float(f"{1.0 / np.diff(look.scene.times).mean():.4g}")
    return (
        f"{len(scene.views)} cameras show a body of {look.size:.2g} m in {len(scene.times)} frames, {rate:g} a "
        f"second; it reaches the ground at frame {scene.hit_frame}."
    )


def facts(look: Look) -> list[tuple[str, str, str]]:
    """What was found, and how it is known."""
    scene, (x, y, z) = look.scene, (look.upper - look.lower).tolist()
    why = {value.key: value.why.split("; ", 1)[-1] for value in scene.values}
    covered = 100 * (1.0 - max(float(np.nanmax(hull.outside)) for hull in look.hulls.values()))
    seconds = scene.times[-1] - scene.times[0]
    clocks = [("clocks", "measured", scene.notes["clocks"])] if "clocks" in scene.notes else []
    mattes = f"{scene.notes.get('mattes', 'as given')}; the worst of all pictures"
    return [
        ("body", f"{x:.2g}, {y:.2g}, {z:.2g} m", "along x, y and z at frame 0, from the outlines of all views"),
        ("frames", f"{len(scene.times)} in {seconds:.3g} s", why.get("physics.frame_rate", "")),
        ("scale", "metres", scene.notes.get("scale", "as stated")),
        ("up", "y", scene.notes.get("up", "as stated")),
        ("ground", f"y = {scene.ground_height:.3g} m", scene.notes.get("ground", "as stated")),
        ("contact", f"frame {scene.hit_frame}", why.get("phases.velocity.init_args.hit_frame", "")),
        ("mattes", f"{covered:.1f} % in the hull", mattes),
        ("cameras", str(len(scene.views)), ", ".join(view.name for view in scene.views)),
        *clocks,
    ]


def cameras(look: Look, warnings: Sequence[SceneWarning]) -> list[tuple[str, list[str], list[Any]]]:
    """Of each camera its name, what is doubtful about it, and two pictures: each with its title, how well the matte
    fits the hull, and whether that is well enough.
    """
    scene, found = look.scene, []
    moments = (0, "frame 0"), (scene.hit_frame, f"contact, frame {scene.hit_frame}")
    for number, (view, pictures) in enumerate(zip(scene.views, camera_pictures(look), strict=True)):
        doubts = [one.kind for one in warnings if 0 < len(one.cameras) < len(scene.views) and view.name in one.cameras]
        figures = []
        for drawn, (frame, when) in zip(pictures, moments, strict=True):
            inside = 1.0 - look.hulls[frame].outside[number]  # NaN where the object is not seen
            said = f"{100 * inside:.1f} % of the matte in the hull" if np.isfinite(inside) else "object not seen"
            figures.append((drawn, when, said, not inside < INSIDE))
        found.append((view.name, list(dict.fromkeys(doubts)), figures))
    return found


def height_data(look: Look) -> dict[str, Any]:
    """Heights over time for the chart; nothing where too little is seen."""
    times = look.scene.times - look.scene.times[0]
    shown = (np.arange(len(times)) <= look.flight) & (look.scene.hit_frame >= look.flight)
    centre, lowest = look.parabolas
    return {
        "times": times.round(5).tolist(),
        "hit": look.scene.hit_frame,
        "ground": look.scene.ground_height,
        "lines": [
            {"label": label, "y": plain(values), "dash": dash}
            for label, values, dash in (
                ("centre", look.centre, False),
                ("lowest point", look.lowest, False),
                ("free fall of the centre", np.where(shown, centre, np.nan), True),
                ("free fall of the lowest point", np.where(shown, lowest, np.nan), True),
            )
            if np.isfinite(values).any()
        ],
    }


def fall_sentence(look: Look) -> str:
    """What the parabola says, and how well it fits."""
    if look.scene.hit_frame < look.flight:
        return (
            f"The body touches the ground at frame {look.scene.hit_frame}, before three frames of free flight are "
            "seen: gravity cannot be measured, and no parabola is drawn."
        )
    rest = f"{1e3 * look.residual:.2g} mm rms" if look.flight > 3 else "not measurable from three frames"
    speed, error, gravity = map(np.linalg.norm, (look.motion.acceleration, look.motion.error, look.scene.gravity))
    return (
        f"Dashed: free fall fitted to frames 0-{look.flight - 1}. The acceleration is {speed:.3g} m/s² (to "
        f"{error:.1g}; gravity in scene.yaml is {gravity:.3g}), the distance of the body from the parabola {rest}. "
        "The contact is where the lowest point on its parabola reaches the ground."
    )


def camera_pictures(look: Look) -> list[list[str]]:
    """The SVG of every camera's first and contact frame [(V, 2)], small enough to travel inside the page."""
    frames = (0, look.scene.hit_frame)
    photos = [[_photo(look, view, frame) for frame in frames] for view in look.scene.views]
    for longest, quality in LADDER:
        images = [[atlas(p[None], size_within(longest, *p.shape[:2]), quality) for p in row] for row in photos]
        if sum(len(uri) for row in images for uri in row) <= IMAGE_BUDGET:
            break
    return [
        [_drawn(look, number, frame, uri) for frame, uri in zip(frames, row, strict=True)]
        for number, row in enumerate(images)
    ]


def space_data(look: Look) -> dict[str, Any]:
    """Cameras, hull at frame 0, box and ground for the page's view into space."""
    hull = look.hulls[0]
    chosen = np.random.default_rng(0).permutation(len(hull.points))[:MOST_POINTS]
    points = hull.points[chosen] if len(chosen) else look.scene.lower[None]
    integers, lower, extent = quantised(points)
    middle = 0.5 * (look.scene.lower + look.scene.upper)
    return {
        "points": base64_array(integers),
        "lower": lower,
        "extent": extent,
        "count": len(chosen),
        "cell": hull.cell,
        "box": [look.scene.lower.tolist(), look.scene.upper.tolist()],
        "ground": look.scene.ground_height,
        "axis": _axis_length(look),
        "cameras": [_frustum(view, middle) for view in look.scene.views],
    }


def _photo(look: Look, view: View, frame: int) -> np.ndarray:
    """What the camera saw [0..255, (H, W, 3), uint8]; grey where it shows nothing."""
    seen = picture(look.scene.pixels(view, frame), view.plate)
    seen = np.where(view.valid[..., None], seen, 0.5)
    return np.round(255.0 * np.clip(seen, 0.0, 1.0)).astype(np.uint8)


def _drawn(look: Look, number: int, frame: int, image: str) -> str:
    scene, view, hull = look.scene, look.scene.views[number], look.hulls[frame]
    moving = look.views[frame][number]
    height, width = view.valid.shape
    layers = (
        ("grid", overlay.lines(_ground(look)[0], view)),
        ("box", overlay.lines(overlay.box_edges(scene.lower, scene.upper), moving)),
        ("hull", overlay.outline(*hull_picture(hull.points, hull.cell, moving))),
        ("matte", overlay.outline(hull.mattes[number], np.zeros(2), 1.0)),
    )
    origin = 0.5 * (scene.lower + scene.upper)
    origin[1] = scene.ground_height
    size = 0.055 * max(height, width)
    least, most = 0.9 * size, (width - 0.9 * size, height - 0.5 * size)
    axes = [
        (name, line, *np.clip(end, least, most)) for name, line, end in overlay.axes(origin, _axis_length(look), view)
    ]
    title = f"camera {view.name}, frame {frame}"
    return parts("scene").picture(width, height, title, image, layers, axes, size)


def _ground(look: Look) -> tuple[list[overlay.Segment], float]:
    """Grid under the box and the body at contact, with half their size around them, and its step [m]."""
    hulls = [hull.points for hull in look.hulls.values() if len(hull.points)]
    every = np.concatenate([look.scene.lower[None], look.scene.upper[None], *hulls])
    lower, upper = every.min(axis=0), every.max(axis=0)
    room = 0.5 * float((upper - lower)[[0, 2]].max())
    return overlay.ground_grid(lower - room, upper + room, look.scene.ground_height)


def _axis_length(look: Look) -> float:
    return 0.6 * float((look.scene.upper - look.scene.lower).max())


def _frustum(view: View, middle: np.ndarray) -> dict[str, Any]:
    """Name, centre and the four corners of the image at a distance [m]."""
    height, width = view.valid.shape
    depth = FRUSTUM * float(np.linalg.norm(middle - view.pose[:, 3]))
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    ahead = (corners - view.intrinsic[:2, 2]) / view.intrinsic[[0, 1], [0, 1]] * [1.0, -1.0]
    rays = np.column_stack((ahead, -np.ones(4))) @ view.pose[:, :3].T
    return {
        "name": view.name,
        "centre": view.pose[:, 3].round(5).tolist(),
        "corners": (view.pose[:, 3] + depth * rays).round(5).tolist(),
    }
