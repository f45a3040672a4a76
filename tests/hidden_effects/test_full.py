"""What a user would say of a video that is to be reconstructed."""

import numpy as np

from benchmarks.hidden_effects.full import first_touch


def test_a_body_that_a_coarse_grid_holds_off_the_ground_touches_it():
    assert first_touch(np.array([0.5, 0.2, 0.03, 0.025, 0.03]), spacing=0.05) == 2
    assert first_touch(np.array([0.5, 0.015, 0.005]), spacing=0.02) == 1


def test_without_contact_the_last_frame_has_to_do():
    assert first_touch(np.array([0.5, 0.4, 0.3]), spacing=0.05) == 2
