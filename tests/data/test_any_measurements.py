"""Whatever a CSV of tracked points holds: it is read as it was written, or one line says what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacnerf_lpo.data.measurements import COLUMNS, SIGMA, read_tracked_points
from pacnerf_lpo.errors import UserInputError

TIMES = (0.0, 0.1, 0.2, 0.3, 0.4)
COORDINATE = st.floats(-100.0, 100.0, allow_subnormal=False)  # a thread of torch may take 1e-309 m for 0
ROWS = st.dictionaries(
    st.tuples(st.sampled_from(TIMES), st.sampled_from(["nose", "left ear", "7"])),
    st.tuples(COORDINATE, COORDINATE, COORDINATE, st.floats(1e-6, 1.0)),
    min_size=4,
)
CELL = st.one_of(st.floats().map(str), st.text(max_size=8), st.sampled_from(["", "nan", '"', "0.1", "1e400", "\x00"]))
TABLE = st.lists(st.lists(CELL, max_size=7).map(",".join), max_size=8).map("\n".join)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("points") / "points.csv"


@given(ROWS)
def test_what_was_written_is_read(path: Path, rows: dict):
    lines = [",".join([*COLUMNS, SIGMA])]
    lines += [f"{time!r},{name},{','.join(map(repr, values))}" for (time, name), values in rows.items()]
    path.write_text("\n".join(lines))
    found = read_tracked_points(path, TIMES)
    assert (np.diff(found.times) >= 0).all()
    numbers = np.column_stack([found.positions, found.sigma]).tolist()
    keys = zip(found.times.tolist(), found.ids.tolist(), strict=True)
    assert dict(zip(keys, map(tuple, numbers), strict=True)) == rows


@given(st.sampled_from([",".join(COLUMNS) + "\n", ",".join([*COLUMNS, SIGMA]) + "\n", ""]), TABLE)
def test_any_text_is_read_or_refused_in_one_line(path: Path, header: str, body: str):
    path.write_text(header + body, encoding="utf-8", errors="surrogatepass")
    try:
        found = read_tracked_points(path, TIMES)
    except UserInputError as error:
        assert str(path) in str(error)
    else:
        assert np.isfinite(found.positions).all() and (found.sigma > 0).all()


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused_in_one_line(path: Path, content: bytes):
    path.write_bytes(content)
    with pytest.raises(UserInputError, match=r"points\.csv"):
        read_tracked_points(path, TIMES)
