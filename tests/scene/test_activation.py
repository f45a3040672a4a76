"""Density to opacity."""

import math

import pytest
import torch

from pacnerf_lpo.scene.activation import DENSITY_SHIFT, EMPTY_DENSITY, alpha, sample_length


@pytest.mark.parametrize("delta", [1.0, 0.05, 0.00625])
def test_alpha_matches_its_defining_formula(delta):
    density = torch.linspace(-5, 40, 100, dtype=torch.float64)
    expected = 1 - (1 + (density + DENSITY_SHIFT).exp()) ** -delta
    # torch's softplus(x) is x above 20: wrong by at most exp(-20).
    torch.testing.assert_close(alpha(density, delta), expected, rtol=0, atol=math.exp(-20))


def test_zero_density_has_alpha_1e_4_over_unit_length():
    assert math.isclose(float(alpha(torch.zeros(1, dtype=torch.float64), 1.0)), 1e-4, rel_tol=1e-10)


def test_small_alpha_keeps_its_digits_in_single_precision():
    exact = float(alpha(torch.tensor(-3.0, dtype=torch.float64), 0.05))
    single = float(alpha(torch.tensor(-3.0), 0.05))
    # float32 rounding of sigma + b (about 12) changes its exponential by 12 eps.
    assert math.isclose(single, exact, rel_tol=20 * torch.finfo(torch.float32).eps)


def test_empty_nodes_are_invisible():
    assert float(alpha(torch.tensor(EMPTY_DENSITY), 1.0)) < 1e-30


def test_sample_length_follows_the_voxel_size():
    assert math.isclose(sample_length(0.02, 0.16), 0.05 / 8)
