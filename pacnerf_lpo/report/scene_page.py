"""``scene.html``: shows a person whether a scene is right, one page that opens without network."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.look import Look
from pacnerf_lpo.data.recordings.scene_warnings import SceneWarning
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report import overlay
from pacnerf_lpo.report.encoding import plain
from pacnerf_lpo.report.page import page
from pacnerf_lpo.report.scene_pictures import camera_pictures, ground_step, space_data

PAGE_FILE = "scene.html"
STYLES = ("report.css", "scene.css")
SCRIPTS = ("base.js", "charts.js", "space.js", "scene.js")
INSIDE = 0.98
"""Share of a matte that the hull covers, from which on the two agree up to the hull's cells."""


def write_scene_page(look: Look, warnings: Sequence[SceneWarning]) -> Path:
    """Write ``scene.html`` next to scene.yaml; returns its path."""
    path = look.scene.folder / PAGE_FILE
    write_atomically(path, render_page(look, warnings).encode())
    return path


def render_page(look: Look, warnings: Sequence[SceneWarning]) -> str:
    """The page as text."""
    scene = look.scene
    name = scene.folder.resolve().name
    return page(
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
        layers={**overlay.LAYERS, "grid": f"ground, squares of {ground_step(look):g} m"},
        cameras=cameras(look, warnings),
        fall=fall_sentence(look),
        all_values=scene.values,
    )


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
    clocks = [("clocks", "", scene.notes["clocks"])] if "clocks" in scene.notes else []
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
            inside = 1.0 - look.hulls[frame].outside[number]
            if np.isfinite(inside):
                figures.append((drawn, when, f"{100 * inside:.1f} % of the matte in the hull", inside >= INSIDE))
            else:
                figures.append((drawn, when, "object not seen", True))
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
    speed = float(np.linalg.norm(look.motion.acceleration))
    error = float(np.linalg.norm(look.motion.error))
    if look.scene.hit_frame < look.flight:
        return (
            f"The body touches the ground at frame {look.scene.hit_frame}, before three frames of free flight are "
            "seen: gravity cannot be measured, and no parabola is drawn."
        )
    rest = f"{1e3 * look.residual:.2g} mm rms" if look.flight > 3 else "not measurable from three frames"
    gravity = float(np.linalg.norm(look.scene.gravity))
    return (
        f"Dashed: free fall fitted to frames 0-{look.flight - 1}. The acceleration is {speed:.3g} m/s² (to "
        f"{error:.1g}; gravity in scene.yaml is {gravity:.3g}), the distance of the body from the parabola {rest}. "
        "The contact is where the lowest point on its parabola reaches the ground."
    )
