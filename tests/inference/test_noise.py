"""The noise model, by simulation in the linear world of toy.py."""

import numpy as np
import pytest

from pacnerf_lpo.inference.layout import AT_REST, Layout
from pacnerf_lpo.inference.noise import NoiseModel
from tests.inference import toy

LAYOUT, WORLD = toy.layout(), toy.World()
SIZE = len(LAYOUT)
SENSOR = np.full(SIZE, toy.SENSOR)


def covariance(noise: NoiseModel) -> np.ndarray:
    """What the fields of a noise model stand for, with the error of the mean."""
    every = np.eye(len(noise.mean))
    lower = np.linalg.inv(noise.series.multiply(noise.whitener, every))
    inner = every + (noise.basis * noise.weights**2) @ noise.basis.T
    return (1 + 1 / len(noise.replicates)) * lower @ inner @ lower.T


def test_whitening_inverts_the_covariance():
    """W C W^T = I up to rounding of 192 terms; no variance is below that of the sensor."""
    noise = NoiseModel.from_replicates(WORLD.draw(np.random.default_rng(7), 16), SENSOR, LAYOUT)
    whitener, whole = noise.whiten(np.eye(SIZE)), covariance(noise)
    np.testing.assert_allclose(whitener @ whole @ whitener.T, np.eye(SIZE), atol=1e-9)
    assert (np.sqrt(np.diag(whole)) >= toy.SENSOR).all()
    np.testing.assert_allclose(noise.adjoint(np.eye(SIZE)), whitener.T, atol=1e-9)
    np.testing.assert_allclose(noise.inverse_adjoint(noise.adjoint(np.eye(SIZE))), np.eye(SIZE), atol=1e-9)


def test_directions_add_their_outer_product_to_the_covariance():
    """C + B B^T, whether B is given at once, or one part after the other; also in every left-out model."""
    drawn, B = WORLD.draw(np.random.default_rng(8), 10), toy.jacobian()
    plain = NoiseModel.from_replicates(drawn, SENSOR, LAYOUT)
    wider = plain.with_directions(B[:, :2]).with_directions(B[:, 2:])
    expected = covariance(plain) + (1 + 1 / 10) * B @ B.T
    np.testing.assert_allclose(covariance(wider), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariance(NoiseModel.from_replicates(drawn, SENSOR, LAYOUT, B)), expected, atol=1e-9)
    x = np.random.default_rng(9).standard_normal(SIZE)
    assert np.sum(wider.whiten(x) ** 2) == pytest.approx(float(x @ np.linalg.solve(expected, x)), rel=1e-9)
    (less, replicate), (less_plain, _) = wider.left_out[3], plain.left_out[3]
    np.testing.assert_array_equal(replicate, drawn[3])
    np.testing.assert_allclose(covariance(less) - covariance(less_plain), (1 + 1 / 9) * B @ B.T, atol=1e-9)


def test_a_part_has_its_block_of_the_mean_and_the_covariance():
    """Of some views and frames, of single entries anywhere, and of a part of a part; directions and left-out models
    included.
    """
    rng = np.random.default_rng(10)
    kinds = LAYOUT.kind[:, None] == np.array(toy.KINDS)
    shared = np.where(LAYOUT.frame == 0, toy.SENSOR, -toy.SENSOR)[:, None] * kinds
    whole = NoiseModel.from_replicates(WORLD.draw(rng, 10), SENSOR, LAYOUT, toy.jacobian(), shared)
    for rows in ((LAYOUT.view != 1) & (LAYOUT.frame < 8), rng.random(SIZE) < 0.5):
        part = whole.among(rows)
        np.testing.assert_array_equal(part.mean, whole.mean[rows])
        np.testing.assert_allclose(covariance(part), covariance(whole)[np.ix_(rows, rows)], atol=1e-9)
        again = part.among(LAYOUT.kind[rows] == "x")
        one = rows & (LAYOUT.kind == "x")
        np.testing.assert_allclose(covariance(again), covariance(whole)[np.ix_(one, one)], atol=1e-9)
        x = rng.standard_normal(int(rows.sum()))
        assert np.sum(part.whiten(x) ** 2) == pytest.approx(float(x @ np.linalg.solve(covariance(part), x)))
        np.testing.assert_allclose(part.inverse_adjoint(part.adjoint(x)), x, atol=1e-9)
        (less, replicate), (of_whole, full) = part.left_out[4], whole.left_out[4]
        np.testing.assert_array_equal(replicate, full[rows])
        np.testing.assert_allclose(covariance(less), covariance(of_whole)[np.ix_(rows, rows)], atol=1e-9)


def test_noise_of_the_frame_to_which_all_are_relative_is_common_to_its_view():
    """x_t = e_t - e_0: a constant shift of one view is as probable as its frame 0 is noisy, not sqrt(11) times less."""
    own = np.where(LAYOUT.frame == 0, 0.0, toy.SENSOR)
    kinds = LAYOUT.kind[:, None] == np.array(toy.KINDS)
    shared = np.where(LAYOUT.frame == 0, toy.SENSOR, -toy.SENSOR)[:, None] * kinds

    def drawn(rng: np.random.Generator, count: int) -> np.ndarray:
        noise = toy.SENSOR * rng.standard_normal((count, toy.VIEWS, toy.FRAMES, len(toy.KINDS)))
        first = noise[:, :, :1].copy()
        noise -= first
        noise[:, :, :1] = first
        return noise.reshape(count, SIZE)

    rng = np.random.default_rng(4)
    noise = NoiseModel.from_replicates(drawn(rng, 8), own, LAYOUT, shared_sigma=shared)
    shift = noise.whiten(toy.one_view(1, "x", np.where(np.arange(toy.FRAMES) == 0, 1.0, -1.0)))
    scores = [shift @ noise.whiten_residual(null) / np.linalg.norm(shift) for null in drawn(rng, 400)]
    assert np.std(scores) == pytest.approx(1.0, abs=0.15)  # four standard errors
    assert np.mean([np.mean(noise.whiten_residual(null) ** 2) for null in drawn(rng, 50)]) == pytest.approx(1, abs=0.1)


def test_kinds_of_one_view_and_frame_err_together():
    """Entries x and size of a frame have 0.8 of their noise in common: their sum errs by more than two entries with a
    noise of their own would, their difference by less; frames and views are independent.
    """
    root = toy.SENSOR * np.eye(len(toy.KINDS))
    root[2, [0, 2]] = toy.SENSOR * np.array([0.8, 0.6])
    places = np.array([toy.KINDS.index(kind) for kind in LAYOUT.kind])

    def drawn(rng: np.random.Generator, count: int) -> np.ndarray:
        noise = rng.standard_normal((count, toy.VIEWS, toy.FRAMES, len(toy.KINDS)))
        return (noise @ root.T).reshape(count, SIZE)

    rng = np.random.default_rng(6)
    noise = NoiseModel.from_replicates(drawn(rng, 16), root[places], LAYOUT)
    for sign in (1.0, -1.0):
        along = toy.one_view(1, "x", np.ones(toy.FRAMES)) + sign * toy.one_view(1, "size", np.ones(toy.FRAMES))
        changed = noise.whiten(along)
        error = toy.SENSOR * np.sqrt(0.2 if sign < 0 else 1.8)  # of the half of a sum or difference, twelve frames
        assert 1 / np.linalg.norm(changed) == pytest.approx(error / np.sqrt(2 * toy.FRAMES), rel=0.15)
        scores = [changed @ noise.whiten_residual(null) / np.linalg.norm(changed) for null in drawn(rng, 400)]
        assert np.std(scores) == pytest.approx(1.0, abs=0.15)  # four standard errors


def test_entries_in_any_order_and_gaps_in_the_frames_are_the_same_problem():
    rng = np.random.default_rng(2)
    drawn, kept = WORLD.draw(np.random.default_rng(7), 16), rng.permutation(SIZE)[:150]
    null = WORLD.draw(rng, 1)[0]
    order = np.sort(kept)
    squares = [
        np.sum(
            NoiseModel.from_replicates(drawn[:, at], SENSOR[at], toy.entries(LAYOUT, at)).whiten_residual(null[at]) ** 2
        )
        for at in (kept, order)
    ]
    assert squares[0] == pytest.approx(squares[1], rel=1e-9)


@pytest.mark.parametrize(
    ("replicates", "sigma", "words"),
    [
        (np.zeros((3, SIZE)), SENSOR, "at least 4"),
        (np.zeros((8, SIZE)), SENSOR[:-1], "sensor_sigma has shape"),
        (np.zeros((8, SIZE)), 0 * SENSOR, "must have a noise"),
        (np.full((8, SIZE), np.nan), SENSOR, "finite"),
    ],
)
def test_unusable_replicates_are_refused(replicates, sigma, words):
    with pytest.raises(ValueError, match=words):
        NoiseModel.from_replicates(replicates, sigma, LAYOUT)


def test_replicates_without_numerical_error_leave_the_sensor_noise():
    """Then ||W r||^2 is chi^2 with 192 degrees of freedom, but for the spread that was learnt from noise."""
    rng = np.random.default_rng(3)
    noise = NoiseModel.from_replicates(toy.SENSOR * rng.standard_normal((16, SIZE)), SENSOR, LAYOUT)
    squares = [(noise.whiten_residual(toy.SENSOR * rng.standard_normal(SIZE)) ** 2).sum() for _ in range(50)]
    assert 0.8 * SIZE < np.mean(squares) < 1.05 * SIZE


def test_an_error_whose_direction_is_known_is_noise():
    """The data show an error that the replicates have not, three standard deviations of one that is known beforehand:
    the mean square of the standardised residual is about 1 then, and much larger otherwise.
    """
    error = toy.seen(along_x=toy.CONTACT, taller=toy.CONTACT**2)[:, None]
    found = {}
    for directions in (None, error):
        rng = np.random.default_rng(11)
        noise = NoiseModel.from_replicates(WORLD.draw(rng, 16), SENSOR, LAYOUT, directions)
        measured = [WORLD.draw(rng, 1)[0] + 3 * rng.choice([-1, 1]) * error[:, 0] for _ in range(30)]
        found[directions is not None] = np.median([np.mean(noise.whiten_residual(one) ** 2) for one in measured])
    assert found[True] < 1.3 < 2 * found[True] < found[False]


def test_errors_at_rest_are_no_measure_of_those_of_motion():
    """Where views disagree by ten times as much at frame 0 as later, as a wrong shape makes them, left-out replicates
    are as large as the model says in every frame: within a fifth, of 16 entries and 40 replicates.
    """
    rng = np.random.default_rng(4)
    size = np.where(LAYOUT.frame == 0, 10.0, 1.0) * toy.SENSOR
    layout = Layout(LAYOUT.view, np.where(LAYOUT.frame == 0, AT_REST, LAYOUT.frame), LAYOUT.kind)
    noise = NoiseModel.from_replicates(size * rng.standard_normal((40, SIZE)), 0.1 * SENSOR, layout)
    left = np.array([model.whiten_residual(replicate) for model, replicate in noise.left_out])
    for frame in range(3):
        assert (left[:, LAYOUT.frame == frame] ** 2).mean() == pytest.approx(1.0, abs=0.2)
