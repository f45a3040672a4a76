"""The verdict of all rounds."""

from __future__ import annotations

import pytest

from pacnerf_lpo.diagnosis.comparison import Error
from pacnerf_lpo.diagnosis.competition import more_than_noise
from pacnerf_lpo.diagnosis.rounds import removed_share, unknown_wins, verdict
from pacnerf_lpo.diagnosis.screening import FORCE, SHAPE
from tests.diagnosis.examples import check, refit, round_of, screening

QUIET = screening(**{FORCE: 1.0, SHAPE: 1.0, "LinearDrag": 2.0})
PUSHED = screening(**{FORCE: 40.0, SHAPE: 10.0, "LinearDrag": 12.0})
DENTED = screening(**{FORCE: 40.0, SHAPE: 41.0, "LinearDrag": 12.0})
KNOWN = screening(**{FORCE: 1.0, "LinearDrag": 2.0})  # a shape that is known cannot be wrong
DRAG, SHIFT = refit("LinearDrag"), refit("CameraShift@2")


@pytest.mark.parametrize(
    ("rounds", "kind", "names", "more_than_noise"),
    [
        ([round_of(screened=QUIET)], "nothing", [], False),
        ([round_of(screened=QUIET, held=(0.001, 3.0))], "nothing", [], True),
        ([round_of(screened=None, finished=False)], "unfinished", [], False),
        ([round_of(screened=PUSHED, finished=False)], "unfinished", [], True),
        ([round_of(screened=PUSHED)], "unknown", [], True),
        ([round_of(screened=DENTED)], "nothing", [], True),
        ([round_of(screened=KNOWN)], "nothing", [], False),
        ([round_of(screened=KNOWN, held=(0.001, 3.0))], "unknown", [], True),
        ([round_of(accepted=DRAG, screened=PUSHED), round_of(screened=QUIET)], "missing", ["LinearDrag"], False),
        (
            [round_of(accepted=DRAG, screened=PUSHED), round_of(screened=QUIET, held=(1e-4, 3.0))],
            "missing",
            ["LinearDrag"],
            True,
        ),
        (  # no force explains what is left
            [round_of(accepted=DRAG, screened=KNOWN), round_of(screened=KNOWN, held=(1e-3, 3.0))],
            "missing",
            ["LinearDrag"],
            True,
        ),
        ([round_of(accepted=DRAG, screened=PUSHED), round_of(screened=PUSHED)], "unknown", ["LinearDrag"], True),
        ([round_of(accepted=SHIFT, screened=QUIET), round_of(screened=QUIET)], "camera", ["CameraShift@2"], False),
        (
            [round_of(accepted=SHIFT), round_of(accepted=DRAG), round_of(screened=QUIET)],
            "missing",
            ["CameraShift@2", "LinearDrag"],
            False,
        ),
        (
            [round_of(accepted=DRAG), round_of(accepted=SHIFT), round_of(), round_of(removed=["LinearDrag"])],
            "camera",
            ["CameraShift@2"],
            False,
        ),
        ([round_of(accepted=DRAG), round_of(removed=["LinearDrag"], screened=QUIET)], "nothing", [], False),
    ],
)
def test_every_kind_of_verdict(rounds, kind, names, more_than_noise):
    found = verdict(rounds)
    assert (found.kind, found.names, found.more_than_noise) == (kind, names, more_than_noise)
    assert (found.removed is None) == (not names)


def test_a_force_does_not_win_where_an_effect_was_accepted():
    assert unknown_wins(round_of(screened=PUSHED))
    assert not unknown_wins(round_of(screened=PUSHED, accepted=DRAG))
    assert not unknown_wins(round_of(screened=screening(**{SHAPE: 1.0})))


def test_what_is_removed_is_a_share_of_the_excess_of_the_held_out_error():
    """From 4 to 1, three of four; below the replicates, all; above where it began, none."""
    first = round_of(errors=(Error(9.0, 9.0),))
    for left, share in ((1.0, 0.75), (-0.5, 1.0), (8.0, 0.0)):
        last = round_of(errors=(Error(4.0, 9.0), Error(left, 9.0)))
        assert removed_share(first, last) == pytest.approx(share)
    quiet, last = round_of(errors=(Error(-0.2, 9.0),)), round_of(errors=(Error(-0.2, 2.0), Error(0.0, 0.5)))
    assert removed_share(quiet, last) == pytest.approx(0.75)  # of the fitted data, as nothing held out shows it


def test_further_hypotheses_are_fitted_while_the_best_leaves_more_than_noise():
    found = round_of()
    found.check = check(1e-4, 3.0)
    size = int(found.comparison.cost) - 1
    assert more_than_noise(found, [], size)
    assert more_than_noise(found, [refit("LinearDrag", cost=size + 10.0)], size)
    assert not more_than_noise(found, [refit("LinearDrag", cost=size - 10.0)], size)
    found.check = check(0.2, 3.0)
    assert not more_than_noise(found, [], size)
    found.held = check(1e-4, 3.0)
    assert more_than_noise(found, [], size)
