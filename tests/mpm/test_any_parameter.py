"""Coordinates in which parameters are optimised: one to one, increasing, and inside the bounds."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.parameters import Identity, Log10, Parameter, Saturated, name_in, own_name

TRANSFORMS = {
    "logarithm": (Log10(), st.floats(-12.0, 12.0)),
    "saturated": (Saturated(0.45), st.floats(-1.0, 1.0)),
    "identity": (Identity(), st.floats(-1e6, 1e6)),
}
"""With free coordinates: where tanh is so flat that rounding matters is left out."""


@pytest.mark.parametrize("name", TRANSFORMS)
@given(data=st.data())
def test_a_coordinate_and_its_value_belong_together(name: str, data: st.DataObject):
    transform, coordinates = TRANSFORMS[name]
    first, second = sorted((data.draw(coordinates), data.draw(coordinates)))
    values = [float(transform.to_physical(torch.tensor(free, dtype=torch.float64))) for free in (first, second)]
    assert values[0] <= values[1]
    for free, value in zip((first, second), values, strict=True):
        assert transform.to_free(value) == pytest.approx(free, rel=1e-9, abs=1e-9)
    assert first in transform.lattice(first, 2.0)


@given(st.floats(0.0, 1e12, exclude_min=True), st.floats(allow_nan=True, allow_infinity=True))
def test_a_value_is_kept_inside_its_bounds_and_refused_elsewhere(high: float, value: float):
    parameter = Parameter("E", "Pa", Log10(), (0.0, high), "modulus")
    if 0.0 < value < high:
        assert parameter.check(value, "here") == value
    else:
        with pytest.raises(UserInputError, match="here: E = "):
            parameter.check(value, "here")


@given(st.text("abc_", min_size=1), st.text(min_size=1))
def test_the_name_in_a_recording_holds_the_own_name(name: str, recording: str):
    assert own_name(name_in(name, recording)) == name
