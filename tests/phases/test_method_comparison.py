"""Images and outlines of a block whose stiffness is known lead back to it, from a wrong one, on a coarse body."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from pacnerf_lpo.evaluation.doubts.identification import doubts_about_methods
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases import method_comparison
from pacnerf_lpo.phases.identification_methods import GaussNewton
from pacnerf_lpo.phases.method_comparison import compare_methods, reduced
from pacnerf_lpo.phases.physics_id import PhysicsIDModule
from tests.phases.conftest import FRAMES, TRUTH, film, outlined, solid_block

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_threads")]


@pytest.fixture
def module(state) -> PhysicsIDModule:
    """An identification that ended at twice the true stiffness, of a body that weighs what it shows."""
    state = solid_block(state)
    law = NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"], known=["nu"])
    true, found = Physics(law, substep_rate=1920.0), PhysicsIDModule(3, GaussNewton())
    path = true.simulate(state, FRAMES)
    found.attach(
        outlined(film(state, path), path[:, state.density > 0], state.spacing), Physics(law, substep_rate=960.0)
    )
    found.import_state(state.with_(physics={**TRUTH, "E": 2 * TRUTH["E"]}))
    return found


def test_both_methods_lead_back_to_the_truth(module: PhysicsIDModule):
    found = compare_methods(module)
    assert found["particles"] > 100 and found["simulations"] > 10
    answers = [found[method]["E"] for method in ("images", "outlines")]
    print(found)
    assert all(abs(np.log10(answer / TRUTH["E"])) < 0.2 for answer in answers)  # a coarse grid errs, but not by 0.3
    assert all(excess > -1.0 for excess in found["excess"].values())  # nobody is better off at the other's answer
    assert list(doubts_about_methods(found, module.physics)) == []


def test_small_images_are_means_of_blocks(data, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(method_comparison, "LONGEST", 12)
    video, small = data.video, reduced(copy(data)).video
    assert small.images.shape[2:] == (12, 12, 3)
    expected = video.images[1, 2, 4:6, 6:8].mean((0, 1))
    torch.testing.assert_close(small.images[1, 2, 2, 3], expected)
    torch.testing.assert_close(small.silhouettes[1, 2, 2, 3], video.silhouettes[1, 2, 4:6, 6:8].mean())
    assert torch.equal(small.intrinsics[0, :2], video.intrinsics[0, :2] / 2)
    hidden = video.valid.clone()
    hidden[0, 4, 6] = False
    blocked = copy(data)
    blocked.video = replace(video, valid=hidden)
    assert (~reduced(blocked).video.valid).nonzero().tolist() == [[0, 2, 3]]
