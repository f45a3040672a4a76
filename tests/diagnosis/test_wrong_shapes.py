"""What errors of the reconstructed shape change, at two resolutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.replicates import distortion
from pacnerf_lpo.identification.shape_errors import shape_errors
from tests.diagnosis import falling


class Reconstructed(falling.Falling):
    """The ball may be longer along x, or as it is."""

    def wrong_bodies(self, body: Body, sigma: float) -> list[Body]:
        centre = body.positions.mean(0)
        longer = 1 + torch.tensor([sigma / falling.RADIUS, 0.0, 0.0])
        return [replace(body, positions=centre + (body.positions - centre) * longer), body]


@pytest.fixture(scope="module")
def ball() -> Reconstructed:
    return Reconstructed({})


def fitted(problem: Reconstructed) -> Model:
    return problem.model((), problem.first_guess)


def test_half_of_the_variance_is_of_each_resolution(ball, monkeypatch):
    falling.install(monkeypatch)
    model = fitted(ball)
    fine, none, coarse, nothing = np.moveaxis(np.nan_to_num(shape_errors(ball, model, model.start)), -1, 0)
    assert not none.any() and not nothing.any(), "a body that is not wrong"
    assert ball.coarse_body.spacing > ball.body.spacing
    sigma = distortion(ball, model.predict(model.start))
    for found, body in ((fine, ball.body), (coarse, ball.coarse_body)):
        pair = [ball.model((), ball.first_guess, one) for one in ball.wrong_bodies(body, sigma)]
        wrong, right = (one.predict(one.start) for one in pair)
        change = np.nan_to_num(ball.relative(wrong - right))
        assert np.abs(change).max() > 0.01
        np.testing.assert_allclose(found, change / 2**0.5, atol=1e-9)


def test_an_error_with_which_the_motion_is_unstable_is_left_out(ball, monkeypatch):
    falling.install(monkeypatch, lambda model, _: not any(model.body is one for one in (ball.body, ball.coarse_body)))
    model = fitted(ball)
    found = np.nan_to_num(shape_errors(ball, model, model.start))
    assert found.shape[-1] == 4 and not found.any()


def test_where_all_are_unstable_it_is_an_error(ball, monkeypatch):
    asked: list[int] = []

    def after_the_first(*_: object) -> bool:
        asked.append(1)
        return len(asked) > 2  # the reference, and the right body, are stable

    falling.install(monkeypatch, after_the_first)
    model = fitted(ball)
    with pytest.raises(SimulationError):
        shape_errors(ball, model, model.start)
