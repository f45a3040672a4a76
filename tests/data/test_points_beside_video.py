"""``data.tracks`` and ``data.clouds``: read with the video, refused before any work."""

from pathlib import Path

import pytest

from pacnerf_lpo.errors import UserInputError
from tests.data.conftest import CENTRE, load

HEADER = "time_s,id,x_m,y_m,z_m\n"


def write(folder: Path, *rows: str) -> str:
    path = folder / "points.csv"
    path.write_text(HEADER + "\n".join(rows))
    return str(path)


def test_points_are_read_with_the_video(scene, tmp_path):
    x, y, z = CENTRE
    found = load(scene, tracks=write(tmp_path, f"0,a,{x},{y},{z}", f"0.1,a,{x},{y - 0.05},{z}"))
    assert found.tracked_points.ids.tolist() == ["a", "a"] and found.point_clouds is None


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (("0,a,1,1,1", "5,a,1,1,1"), r"points\.csv, line 3: time 5 s lies outside the video"),
        (("0,a,0,0,3.5", "0.1,a,0,0,3.5"), r"points\.csv: id a is 3\..* m outside the box"),
    ],
)
def test_wrong_tracks_are_one_clear_error(scene, tmp_path, rows, message):
    with pytest.raises(UserInputError, match=message):
        load(scene, tracks=write(tmp_path, *rows))


def test_a_missing_folder_of_clouds_is_named(scene, tmp_path):
    with pytest.raises(UserInputError, match="nowhere: there is no such folder"):
        load(scene, clouds=str(tmp_path / "nowhere"))
