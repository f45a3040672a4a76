"""scene.html: well formed, self-contained, its lines lie where they belong, and it says what is doubtful."""

from __future__ import annotations

import html
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape
from PIL import Image

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.recordings.look import Look, examine
from pacnerf_lpo.data.recordings.scene_warnings import scene_warnings
from pacnerf_lpo.data.recordings.voxel_hull import hull_picture, projected
from pacnerf_lpo.data.recordings.written_scene import View
from pacnerf_lpo.report import overlay
from pacnerf_lpo.report.scene_page import write_scene_page
from tests.data.recordings.layouts import WRITERS
from tests.data.recordings.studio import CONTACT, FRAMES, NAMES, SIZE, VIEWS
from tests.report.browser import dom
from tests.report.test_report import Balance

pytestmark = pytest.mark.slow

LARGEST = 8e6
"""Bytes of a page."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """The studio with named cameras and lenses in millimetres, through init."""
    folder = tmp_path_factory.mktemp("look")
    (folder / "drop").mkdir()
    WRITERS["opencv_shared"](folder / "drop")
    assert main(["init", str(folder / "drop"), str(folder / "scene")]) == 0
    return folder / "scene"


@pytest.fixture(scope="module")
def page(scene) -> str:
    return (scene / "scene.html").read_text()


@pytest.fixture(scope="module")
def look(scene) -> Look:
    return examine(scene)


def data_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])


def test_page_is_well_formed_self_contained_and_small(page):
    parser = Balance()
    parser.feed(re.sub(r"<(path|input)([^>]*?)/?>", "", page))  # elements that are never closed
    assert parser.open == []
    assert all(address.startswith("data:image/") for address in parser.addresses)
    assert set(re.findall(r"https?://[\w./]+", page)) == {"http://www.w3.org/2000/svg"}
    assert len(page) < LARGEST


def test_first_screen_says_what_was_found_and_how_it_is_known(page):
    head = page[: page.index('id="pictures"')]
    assert f"6 cameras show a body of 0.46 m in {FRAMES} frames, 24 a second" in head
    assert f"reaches the ground at frame {CONTACT}" in head
    for text in ("layout opencv", "mm, as in it the body falls at", "lowest point of the outlines", "2 warnings",
                 "ends soon after the first contact", "The object is small"):  # fmt: skip
        assert text in head
    assert "<code>--density</code>" in page and "&lt;code" not in page


def test_every_camera_has_its_first_and_its_contact_frame_with_all_lines(page):
    figures = re.findall(r"<figure.*?</figure>", page, re.S)
    assert len(figures) == 2 * VIEWS
    for name in NAMES:
        own = [figure for figure in figures if f"camera {name}," in figure]
        assert len(own) == 2 and f"contact, frame {CONTACT}" in own[1]
        for figure in own:
            assert figure.count("data:image/webp") == 1
            assert all(f'<g class="{layer}' in figure for layer in overlay.LAYERS)


def test_every_value_of_scene_yaml_is_in_the_table(page, scene, look):
    table = page[page.index("Every value of scene.yaml") :]
    assert len(look.scene.values) > 12
    for value in look.scene.values:
        assert f"<code>{value.key}</code>" in table and escape(value.text) in table


def test_heights_and_cameras_are_data_of_the_page(page, look):
    data = data_of(page)
    assert data["height"]["hit"] == CONTACT and len(data["height"]["times"]) == FRAMES
    assert [len(line["y"]) for line in data["height"]["lines"]] == [FRAMES] * 4
    assert [camera["name"] for camera in data["space"]["cameras"]] == list(NAMES)
    for view, camera in zip(look.scene.views, data["space"]["cameras"], strict=True):
        pixels, depth = projected(np.array(camera["corners"]), view)
        np.testing.assert_allclose(pixels, [[0, 0], [SIZE, 0], [SIZE, SIZE], [0, SIZE]], atol=0.02)
        assert (depth > 0).all()


def test_the_outline_of_the_hull_is_that_of_the_matte(look):
    """The hull of six views is the ball and a little more: two cells of 56, which are a pixel here."""
    for frame, hull in look.hulls.items():
        for view, matte in zip(look.scene.views, hull.mattes, strict=True):
            mask, corner, scale = hull_picture(hull.points, hull.cell, view)
            place = np.stack(np.meshgrid(*[np.arange(SIZE) + 0.5] * 2), axis=-1)
            column, row = np.floor((place - corner) * scale).astype(int).transpose(2, 0, 1)
            inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
            shown = inside & mask[row * inside, column * inside]
            overlap = (shown & matte).sum() / (shown | matte).sum()
            assert overlap > 0.85, (frame, view.name, overlap)


def camera(pose: np.ndarray) -> View:
    """100 x 80 pixels, focal length 100."""
    intrinsic = np.array([[100.0, 0.0, 50.0], [0.0, 100.0, 40.0], [0.0, 0.0, 1.0]])
    return View(0, "0", intrinsic, pose, np.ones((80, 100), bool), None)


def test_lines_are_cut_off_behind_the_camera_and_at_the_border():
    view = camera(np.column_stack((np.eye(3), np.zeros(3))))  # at the origin, looking along -z
    point = lambda x, y, z: np.array([x, y, z], float)  # noqa: E731
    inside = overlay.clipped((point(0, 0, -1), point(0.1, 0.2, -1)), view)
    np.testing.assert_allclose(inside, [[50, 40], [60, 20]])
    across = overlay.clipped((point(0, 0, -1), point(2, 0, -1)), view)
    np.testing.assert_allclose(across, [[50, 40], [100, 40]])
    # from the ground ahead to the ground behind, one metre below: seen from the lower border to the first point
    through = overlay.clipped((point(0, -1, -10), point(0, -1, 10)), view)
    np.testing.assert_allclose(through, [[50, 50], [50, 80]], atol=1e-6)
    assert overlay.clipped((point(0, 0, 1), point(1, 0, 2)), view) is None
    assert overlay.clipped((point(5, 0, -1), point(5, 1, -1)), view) is None


def test_ground_and_box():
    segments, step = overlay.ground_grid(np.array([-0.3, 0.2, 0.1]), np.array([0.9, 0.5, 0.4]), 0.05)
    assert step == pytest.approx(0.2)
    ends = np.array(segments)
    assert (ends[..., 1] == 0.05).all()
    np.testing.assert_allclose(ends.min(axis=(0, 1))[[0, 2]], [-0.4, 0.0], atol=1e-12)
    np.testing.assert_allclose(ends.max(axis=(0, 1))[[0, 2]], [1.0, 0.4], atol=1e-12)
    edges = np.array(overlay.box_edges(np.zeros(3), np.array([1.0, 2.0, 3.0])))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    assert sorted(lengths) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4


def test_what_a_person_changed_is_drawn_again(scene, tmp_path, capsys, look):
    copy = shutil.copytree(scene, tmp_path / "scene")
    path = copy / "scene.yaml"
    top = f"{look.scene.upper[1]:.4g}"
    text = path.read_text().replace(f"hit_frame: {CONTACT}", f"hit_frame: {CONTACT - 1}").replace(f" {top},", " 0.8,")
    path.write_text(text)
    assert main(["report", str(copy)]) == 0
    said = capsys.readouterr().out
    assert f"{copy / 'scene.html'}" in said and "warning: the body reaches" in said and "above the box along y" in said
    page = (copy / "scene.html").read_text()
    assert f"reaches the ground at frame {CONTACT - 1}" in page and f"contact, frame {CONTACT - 1}" in page
    assert data_of(page)["space"]["box"][1][1] == 0.8


def test_large_images_are_made_smaller(scene, tmp_path, look):
    """Noise, which does not compress, as of cameras of 1600 pixels."""
    copy = shutil.copytree(scene, tmp_path / "scene")
    factor, noise = 16, np.random.default_rng(0).integers(0, 255, (SIZE * 16, SIZE * 16, 3), np.uint8)
    wanted = {f"m_{view}_{frame}.png" for view in range(VIEWS) for frame in (0, 1, 2, CONTACT)}
    for image in (copy / "data").iterdir():
        if image.name not in wanted and image.name.startswith("m_"):
            continue
        large = Image.open(image).resize((SIZE * factor, SIZE * factor))
        if image.name.startswith("m_"):
            large = Image.merge("RGBA", (*Image.fromarray(noise).split(), large.getchannel("A")))
        elif image.name.endswith("_-1.png"):
            large = Image.fromarray(noise)
        large.save(image, compress_level=0)
    entries = json.loads((copy / "all_data.json").read_text())
    kept = [entry for entry in entries if f"m_{entry['file_path'].split('r_')[1]}" in wanted]
    for number, entry in enumerate(kept):
        entry["intrinsic"] = (np.diag([factor, factor, 1.0]) @ entry["intrinsic"]).tolist()
        entry["time"], entry["file_path"] = (number % 4) / 24, f"./data/r_{number // 4}_{number % 4}.png"
    for view in range(VIEWS):
        (copy / "data" / f"m_{view}_{CONTACT}.png").rename(copy / "data" / f"m_{view}_3.png")
    (copy / "all_data.json").write_text(json.dumps(kept))
    path = copy / "scene.yaml"
    path.write_text(path.read_text().replace(f"hit_frame: {CONTACT}", "hit_frame: 3"))
    large_look = examine(copy)
    np.testing.assert_allclose(large_look.lower, look.lower, atol=0.01)
    assert write_scene_page(large_look, scene_warnings(large_look)).stat().st_size < LARGEST


PROBE = """<script>
const seen = [];
addEventListener("error", (event) => seen.push(event.message));
setTimeout(() => {
  document.querySelector('[data-layer="box"]').click();
  const hidden = [...document.querySelectorAll("g.box")].every((part) => part.style.display === "none");
  document.querySelectorAll(".camera figure")[3].click();
  const opened = byId("large").open && byId("large-name").textContent;
  byId("next").click();
  const next = byId("large-name").textContent;
  byId("close").click();
  const canvas = byId("space");
  const pixels = () => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.join();
  const before = pixels();
  canvas.onpointermove({ buttons: 1, movementX: 60, movementY: 20 });
  setTimeout(() => {
    const turned = pixels() !== before;
    byId("near").click();
    byId("theme").click();
    const wide = document.documentElement.scrollWidth <= document.documentElement.clientWidth;
    document.body.dataset.seen = JSON.stringify([seen, hidden, opened, next, byId("large").open, turned, wide,
      document.querySelectorAll("#height svg path.curve").length]);
  }, 200);
}, 300);
</script></body>"""


@pytest.mark.parametrize("width", [1400, 500])
def test_layers_pictures_and_space_work_in_a_browser(page, tmp_path, width):
    seen_page = dom(page, PROBE, tmp_path, f"--window-size={width},900")
    found = json.loads(html.unescape(re.search(r'data-seen="([^"]*)"', seen_page)[1]))
    errors, hidden, opened, following, still_open, turned, fits, curves = found
    assert errors == []
    assert hidden and turned and fits and not still_open
    assert opened == f"camera right, contact, frame {CONTACT}" and following == "camera front, frame 0"
    assert curves == 4
