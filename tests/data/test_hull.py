"""The box around the visual hull holds the object and little else."""

import pytest
import torch

from pacnerf_lpo.data.hull import CELLS, MARGIN, hull_box
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.types import Box

pytestmark = pytest.mark.slow

LARGE = ([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0])


@pytest.fixture(scope="module")
def bird():
    return VideoData("asset:bird", *LARGE).prepare()


def test_the_hull_box_is_tight_and_does_not_cut_the_object(bird, caplog):
    box = hull_box(bird.video, bird.box, bird.train)
    size = torch.tensor(box.upper) - torch.tensor(box.lower)
    assert (size < 0.8).all(), "the bird is about half a metre long"
    VideoData("asset:bird", list(box.lower), list(box.upper)).prepare()
    assert not caplog.records, "no silhouette may stick out of the box"


def test_fewer_views_allow_a_larger_hull(bird):
    few, all_views = (hull_box(bird.video, bird.box, views) for views in (bird.train[:3], bird.train))
    assert all(a <= b for a, b in zip(few.lower, all_views.lower, strict=True))
    assert all(a >= b for a, b in zip(few.upper, all_views.upper, strict=True))


def test_it_stays_inside_the_given_box(bird):
    given = Box((-0.125, 0.625, -0.125), (0.125, 0.8125, 0.125))  # exact in float32; cuts the bird
    box = hull_box(bird.video, given, bird.train)
    assert all(a >= b for a, b in zip(box.lower, given.lower, strict=True))
    assert all(a <= b for a, b in zip(box.upper, given.upper, strict=True))


def test_a_box_beside_the_object_is_an_error(bird):
    with pytest.raises(UserInputError, match="no common point"):
        hull_box(bird.video, Box((0.6, 1.2, 0.6), (0.9, 1.5, 0.9)), bird.train)


def test_margin_is_a_few_cells(bird):
    coarse = hull_box(bird.video, bird.box, bird.train)
    fine = hull_box(bird.video, Box(coarse.lower, coarse.upper), bird.train)
    slack = (MARGIN + 1) * 2.0 / CELLS
    assert all(0 <= b - a <= slack for a, b in zip(coarse.lower, fine.lower, strict=True))
