"""A diagnosis in several processes: the same numbers as in one."""

from __future__ import annotations

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import whole_catalogue
from pacnerf_lpo.diagnosis.comparison import compare
from pacnerf_lpo.identification import model_errors
from pacnerf_lpo.identification.processes import processes
from tests.diagnosis.examples import screened
from tests.diagnosis.test_points import GUESS, Ball, points, tracked

pytestmark = pytest.mark.slow

FORCES = ("LinearDrag", "UniformForce", "GravityMagnitude")


def test_a_diagnosis_is_the_same(small_threads, monkeypatch):
    """Fit, replicates and scores of a ball whose tracks show drag."""
    problem = Ball(points(tracked(), None))
    no_force = np.zeros((*problem.usable.shape, 1))  # saves 120 simulations
    monkeypatch.setattr(model_errors, "force_changes", lambda *_: no_force)
    monkeypatch.setattr(model_errors, "contact_accelerations", lambda *_: np.zeros(1))
    found = []
    for jobs in (1, 2):
        with processes(jobs):
            comparison = compare(problem, (), GUESS, (4, 1), False, lambda _: None)
            catalogue = whole_catalogue(problem.physics.material, problem.video.view_ids, ())
            candidates = [candidate for candidate in catalogue if candidate.name in FORCES]
            found.append((comparison, screened(problem, (), comparison, candidates)))
    (alone, ranking), (together, same) = found
    np.testing.assert_allclose(together.free, alone.free, rtol=1e-5)
    np.testing.assert_allclose(together.errors.replicates, alone.errors.replicates, atol=1e-5)
    assert [score.name for score in same.scores] == [score.name for score in ranking.scores]
    factors = [[s.log_bayes_factor for s in one.scores] for one in (same, ranking)]
    np.testing.assert_allclose(*factors, rtol=1e-3, atol=1e-3)
