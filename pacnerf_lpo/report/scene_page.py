"""``scene.html``: shows a person whether a scene is right, one page that opens without network."""

import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.look import Look
from pacnerf_lpo.data.recordings.scene_warnings import SceneWarning
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report import overlay
from pacnerf_lpo.report.diagnosis_markup import table
from pacnerf_lpo.report.encoding import plain
from pacnerf_lpo.report.page import page
from pacnerf_lpo.report.scene_pictures import camera_pictures, ground_step, space_data
from pacnerf_lpo.report.wording import capitalised

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
    source = f"from {scene.source}, layout {scene.layout}" if scene.source else "a scene"
    name = scene.folder.resolve().name
    return page(
        "scene",
        f"{name}: is the scene right?",
        STYLES,
        SCRIPTS,
        {"space": space_data(look), "height": height_data(look)},
        folder=html.escape(name),
        source=html.escape(source),
        found=html.escape(found_sentence(look)),
        facts=facts_table(look),
        warnings=warning_list(warnings),
        legend=legend(look),
        cameras=camera_figures(look, warnings),
        fall=html.escape(fall_sentence(look)),
        values=values_table(look),
    )


def found_sentence(look: Look) -> str:
    """What was found, in one sentence."""
    scene = look.scene
    return (
        f"{len(scene.views)} cameras show a body of {look.size:.2g} m in {len(scene.times)} frames, {_rate(look):g} a "
        f"second; it reaches the ground at frame {scene.hit_frame}."
    )


def facts_table(look: Look) -> str:
    """What was found, and how it is known."""
    scene, (x, y, z) = look.scene, (look.upper - look.lower).tolist()
    why = {value.key: value.why.split("; ", 1)[-1] for value in scene.values}
    covered = 100 * (1.0 - max(float(np.nanmax(hull.outside)) for hull in look.hulls.values()))
    seconds = scene.times[-1] - scene.times[0]
    facts = [
        ("body", f"{x:.2g}, {y:.2g}, {z:.2g} m", "along x, y and z at frame 0, from the outlines of all views"),
        ("frames", f"{len(scene.times)} in {seconds:.3g} s", why.get("physics.frame_rate", "")),
        ("scale", "metres", scene.notes.get("scale", "as stated")),
        ("up", "y", scene.notes.get("up", "as stated")),
        ("ground", f"y = {scene.ground_height:.3g} m", scene.notes.get("ground", "as stated")),
        ("contact", f"frame {scene.hit_frame}", why.get("phases.velocity.init_args.hit_frame", "")),
        (
            "mattes",
            f"{covered:.1f} % in the hull",
            f"{scene.notes.get('mattes', 'as given')}; the worst of all pictures",
        ),
        ("cameras", str(len(scene.views)), ", ".join(view.name for view in scene.views)),
        *([("clocks", "", scene.notes["clocks"])] if "clocks" in scene.notes else []),
    ]
    rows = [
        f'<tr><td class="muted">{name}</td><td><b>{html.escape(value)}</b></td><td>{said(how)}</td></tr>'
        for name, value, how in facts
    ]
    return table(("", "found", "how it is known"), rows, "why")


def warning_list(warnings: Sequence[SceneWarning]) -> str:
    """Every warning with its remedy, or that there is none."""
    if not warnings:
        return '<p class="verdict good"><b>no warnings</b> Nothing looks wrong. See below whether you agree.</p>'
    items = "".join(
        f'<li class="{one.kind}">{said(capitalised(one.what))}. <span>What to do: {said(one.remedy)}.</span></li>'
        for one in warnings
    )
    count = f"{len(warnings)} warning{'s' * (len(warnings) > 1)}"
    return f'<p class="verdict fair"><b>{count}</b></p><ul class="warnings">{items}</ul>'


def said(words: str) -> str:
    """Plain text as HTML, with options of the command line on one line each."""
    return re.sub(r"--\w+", r"<code>\g<0></code>", html.escape(words))


def legend(look: Look) -> str:
    """Names of what is drawn, as switches."""
    words = {**overlay.LAYERS, "grid": f"ground, squares of {ground_step(look):g} m"}
    return "".join(
        f'<label><input type="checkbox" data-layer="{name}" checked><span class="key {name}"></span>{text}</label>'
        for name, text in words.items()
    )


def camera_figures(look: Look, warnings: Sequence[SceneWarning]) -> str:
    """A pair of pictures for each camera, with how well its mattes fit the hull and what is doubtful about it."""
    scene, parts = look.scene, []
    for number, (view, pictures) in enumerate(zip(scene.views, camera_pictures(look), strict=True)):
        doubts = [one.kind for one in warnings if 0 < len(one.cameras) < len(scene.views) and view.name in one.cameras]
        marks = f"<em>warning: {html.escape(', '.join(dict.fromkeys(doubts)))}</em>" if doubts else ""
        figures = "".join(
            f'<figure tabindex="0" role="button" data-caption="camera {html.escape(view.name)}, {when}">{drawn}'
            f"<figcaption>{when} <span>{_covered(look.hulls[frame].outside[number])}</span></figcaption></figure>"
            for drawn, frame, when in zip(
                pictures, (0, scene.hit_frame), ("frame 0", f"contact, frame {scene.hit_frame}"), strict=True
            )
        )
        parts.append(f'<div class="camera"><h3>camera {html.escape(view.name)} {marks}</h3><div>{figures}</div></div>')
    return "".join(parts)


def _covered(outside: float) -> str:
    if not np.isfinite(outside):
        return "object not seen"
    inside = f"{100 * (1.0 - outside):.1f} % of the matte in the hull"
    return inside if 1.0 - outside >= INSIDE else f"<em>{inside}</em>"


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


def values_table(look: Look) -> str:
    """Every value of scene.yaml with the comment on it."""
    rows = [
        f'<tr><td><code>{html.escape(one.key)}</code></td><td class="value"><b>{html.escape(one.text)}</b></td>'
        f"<td>{said(one.why) or '<span class=muted>as usual</span>'}</td></tr>"
        for one in look.scene.values
    ]
    return table(("value", "is", "where it comes from, and how sure"), rows, "why")


def _rate(look: Look) -> float:
    return float(f"{1.0 / np.diff(look.scene.times).mean():.4g}")
