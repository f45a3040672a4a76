"""Signed residuals: sign, white, symmetry, and ends that stay apart for colour-blind readers."""

import numpy as np
import pytest
import torch

from pacnerf_lpo.report.residual_colours import (
    NEGATIVE,
    POSITIVE,
    comparison_panel,
    residual_colours,
    residual_scale,
    signed_residual,
)

# Vienot, Brettel and Mollon 1999: linear RGB seen by people without long-, or without middle-wavelength cones
DEFICIENCIES = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def test_residual_is_predicted_minus_measured():
    dark, white = torch.zeros(2, 2, 3), torch.ones(2, 2, 3)
    assert (signed_residual(dark, white) == -1).all()
    assert (signed_residual(white, dark) == 1).all()


def test_zero_is_white_and_the_ends_are_orange_and_blue():
    colours = residual_colours(torch.tensor([-0.9, -0.2, 0.0, 0.2, 0.1]), 0.2)
    torch.testing.assert_close(colours[0], torch.tensor(NEGATIVE))
    torch.testing.assert_close(colours[1], torch.tensor(NEGATIVE))
    torch.testing.assert_close(colours[2], torch.ones(3))
    torch.testing.assert_close(colours[3], torch.tensor(POSITIVE))
    torch.testing.assert_close(colours[4], 0.5 * (1 + torch.tensor(POSITIVE)))


@pytest.mark.parametrize("kind", DEFICIENCIES)
def test_the_ends_differ_by_more_than_lightness_for_colour_blind_eyes(kind):
    linear = np.array([NEGATIVE, POSITIVE]) ** 2.2
    seen = np.clip(linear @ np.array(DEFICIENCIES[kind]).T, 0, 1) ** (1 / 2.2)
    yellow_blue = seen[:, :2].mean(1) - seen[:, 2]
    assert yellow_blue[0] > 0.3 and yellow_blue[1] < -0.3


def test_the_ends_are_about_equally_far_from_white_in_luminance():
    luminance = (np.array([NEGATIVE, POSITIVE]) ** 2.2) @ np.array([0.2126, 0.7152, 0.0722])
    assert abs(luminance[0] - luminance[1]) < 0.15


def test_scale_is_the_next_round_number():
    assert residual_scale(torch.full((1000,), 0.13)) == 0.2
    assert residual_scale(torch.zeros(10)) == 0.05
    one_outlier = torch.full((1000,), 0.01)
    one_outlier[0] = 0.9
    assert residual_scale(one_outlier) == 0.05


def test_panel_sets_rendered_measured_and_residual_side_by_side():
    predicted, measured = torch.full((4, 5, 3), 0.25), torch.full((4, 5, 3), 0.75)
    panel = comparison_panel(predicted, measured)
    assert panel.shape == (4, 15, 3)
    torch.testing.assert_close(panel[:, :5], predicted)
    torch.testing.assert_close(panel[:, 5:10], measured)
    torch.testing.assert_close(panel[0, 12], torch.tensor(NEGATIVE))
