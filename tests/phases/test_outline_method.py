"""Identification by outlines: the search finds the valley from three decades away, the fit its bottom."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.least_squares import Fit
from pacnerf_lpo.identification.multistart import Search, horizons, multistart
from pacnerf_lpo.mpm.materials import NeoHookean, ViscoplasticVonMises
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases import GaussNewton, OutlineGaussNewton, PhysicsIDModule
from pacnerf_lpo.phases.outline_method import OutlineCost
from tests.phases.conftest import FRAMES, TRUTH, film, outlined, physics, solid_block
from tests.phases.test_dynamic_phases import HIT, run


def method(**settings) -> OutlineGaussNewton:
    bodies = {"particles": 2000, "coarse_particles": 900, "scan_particles": 400}
    return OutlineGaussNewton(**{"samples": 32, "starts": 4, **bodies, **settings})


@pytest.fixture(scope="module")
def solid(state):
    """A solid block and its film, for which each particle is sixty-four, on a grid of a quarter of the spacing: what is
    identified is extrapolated to vanishing spacing.
    """
    full, spacing = solid_block(state), state.spacing / 4
    within = torch.cartesian_prod(*[(torch.arange(4) - 1.5) / 2 * spacing] * 3)
    many = (full.positions[full.density > 0][:, None] + within).flatten(0, 1)
    fine = Physics(NeoHookean(), substep_rate=3840.0)
    truth = {name: torch.tensor(value) for name, value in TRUTH.items()}
    matter = torch.ones(len(many))
    path = fine.motion(many, full.velocity[:1].expand_as(many), matter, matter, truth, spacing, FRAMES)
    return full, outlined(film(full, full.positions.expand(FRAMES, -1, -1)), path, spacing)


@pytest.mark.slow
def test_modulus_is_found_from_a_guess_that_is_off_by_a_factor_of_a_hundred(solid):
    """A picture of 24 x 24 pixels, and a body that is sampled otherwise: E is known to some ten per cent."""
    state, data = solid
    wrong = state.with_(physics={}, velocity=state.velocity + torch.tensor([0.1, 0.1, -0.1]))
    found = run(PhysicsIDModule(HIT, method()), data, physics(E=3e2), wrong)
    assert math.log10(found.physics["E"] / TRUTH["E"]) == pytest.approx(0.0, abs=0.15)
    # coarse bodies feel the ground a cell or two above it, and the model answers by a faster fall
    assert found.velocity[0].tolist() == pytest.approx([0.0, -1.0, 0.0], abs=0.3)


def test_what_is_not_compared_is_not_simulated(solid):
    """The first frames are as ever, and the rest stands still."""
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, physics(E=TRUTH["E"]))
    module.import_state(state.with_(physics={}))
    whole, part = OutlineCost(module, 800), OutlineCost(module, 800, frames=HIT)
    free = whole.free(module)
    path, short = whole.model.path(free), part.model.path(free)
    assert path.shape == short.shape
    assert torch.equal(short[:HIT], path[:HIT])
    assert torch.equal(short[HIT:], path[HIT - 1].expand_as(short[HIT:]))
    compared = part.residual(free)
    part.model.frames = None
    assert np.array_equal(part.residual(free), compared)


@pytest.mark.slow
def test_fits_that_grow_with_the_frames_find_the_modulus_from_a_single_point_two_decades_away(solid):
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, Physics(NeoHookean(E=1e-2 * TRUTH["E"], nu=TRUTH["nu"], known=["nu"]), substep_rate=960.0))
    module.import_state(state.with_(physics={}))
    outline_cost = OutlineCost(module, 900, 400)
    start, index = outline_cost.free(module), outline_cost.model.names.index("E")
    right = start.copy()
    right[index] = math.log10(TRUTH["E"])
    rows = [outline_cost.rows(until) for until in horizons(HIT, FRAMES)]
    found = multistart([outline_cost.stage(rows)], [start]).fits[0].free
    before, after, at_truth = (np.sum(outline_cost.residual(free) ** 2) for free in (start, found, right))
    assert after < at_truth < before
    assert found[index] == pytest.approx(right[index], abs=0.5)  # bodies so coarse are too stiff


@pytest.mark.slow
def test_fits_on_finer_bodies_decide_between_valleys(solid):
    """A modulus that is wrong by a decade and a half, and one that a short fit corrects."""
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, physics(E=TRUTH["E"]))
    module.import_state(state.with_(physics={}))
    outline_cost = OutlineCost(module, 2000, 900)
    index = outline_cost.model.names.index("E")

    def off_by(decades: float) -> Fit:
        free = outline_cost.free(module)
        free[index] += decades
        return Fit(free, outline_cost.residual(free))

    near, wrong = off_by(0.1), off_by(-1.5)
    assert near.cost > 1.1 * off_by(0.0).cost
    for pair in ((near, wrong), (wrong, near)):
        found = module.method._on_finer(module, pair)[0].free
        assert found[index] == pytest.approx(math.log10(TRUTH["E"]), abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("decades", "halvings"), [(0.0, 0), (2.25, 1)])
def test_finalists_are_compared_at_the_same_time_step(solid, monkeypatch, decades, halvings):
    """The run's own step is too long for a body that is two decades stiffer, and then it is for all."""
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, physics(E=10**decades * TRUTH["E"]))
    module.import_state(state.with_(physics={}))
    monkeypatch.setattr("pacnerf_lpo.phases.outline_method.SEARCH_ITERATIONS", 1)
    monkeypatch.setattr("pacnerf_lpo.identification.least_squares.LONGEST_STEP", 1e-3)
    starts = [OutlineCost(module, 2000).free(module)]
    outline_cost, fits = module.method._fits(module, (2000, 900), starts)
    assert module.physics.halvings == halvings
    assert not outline_cost.needs_shorter_step(fits[0].free)
    assert outline_cost.model.physics.substep_rate == pytest.approx(
        2**halvings * module.physics.substep_rate * state.spacing / outline_cost.model.body.spacing, rel=0.1
    )


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "decided"), [(0.5, "beside"), (0.98, "finer"), (2.0, "best")])
def test_a_neighbouring_minimum_is_taken_where_it_is_much_better_and_left_where_it_is_worse(
    solid, monkeypatch, factor, decided
):
    """The search stands still but for its last stage, which finds a neighbour at E = 1 kPa."""
    state, data = solid
    module = PhysicsIDModule(HIT, method(samples=4, starts=1))
    module.attach(data, physics(E=TRUTH["E"]))
    module.import_state(state.with_(physics={}))
    monkeypatch.setattr(
        OutlineGaussNewton,
        "_on_finer",
        lambda self, module, fits: [Fit(fits[1].free + (0.25 if factor < 1 else 0.0), fits[1].residual)],
    )

    def search(stages, starts, *_):
        (stage,), first = stages, starts[0]
        best = first if isinstance(first, Fit) else Fit(first, stage.residual(first))
        if not stage.offsets:
            return Search([best], 1, 0)
        free = best.free.copy()
        free[outline_cost.model.names.index("E")] = 3.0
        fits = [best, Fit(free, best.residual * factor)]
        return Search(sorted(fits, key=lambda fit: fit.cost), 1, 0)

    outline_cost = OutlineCost(module, 2000)
    monkeypatch.setattr("pacnerf_lpo.phases.outline_method.multistart", search)
    module.method.prepare(module)
    found = module.free["E"].item()
    assert {3.0: "beside"}.get(round(found, 4), "finer" if factor == 0.98 and found > 4.6 else "best") == decided


def test_the_fall_is_fitted_before_the_search(solid, monkeypatch):
    """The modulus, of which a fall tells nothing, stays at the guess."""
    monkeypatch.setattr("pacnerf_lpo.phases.outline_method.multistart", lambda *_: Search([], 0, 0))
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, physics(E=2e4))
    module.import_state(state.with_(physics={}, velocity=state.velocity * 0.8 + 0.1))
    before = module.export_values()
    module.method.prepare(module)
    assert module.velocity.tolist() == pytest.approx([0.0, -1.0, 0.0], abs=0.1)
    assert module.export_values() == pytest.approx(before)


def test_beside_the_outlines_counts_how_far_poissons_ratio_is_from_what_is_usual(solid):
    state, data = solid
    rows = []
    for material in (NeoHookean(E=3e4, nu=0.35), NeoHookean(E=3e4, nu=0.25), NeoHookean(E=3e4, nu=0.25, known=["nu"])):
        module = PhysicsIDModule(HIT, method())
        module.attach(data, Physics(material, substep_rate=960.0))
        module.import_state(state.with_(physics={}))
        for bodies in ((800,), (800, 300)):
            outline_cost = OutlineCost(module, *bodies)
            rows.append(outline_cost.residual(outline_cost.free(module)))
    assert [row[-1] for row in rows[:4]] == pytest.approx([0.0, 0.0, -(10**0.5), -(10**0.5)], abs=1e-5)
    assert len(rows[4]) == len(rows[5]) == len(rows[0]) - 1


@pytest.mark.slow
def test_a_flow_extrapolated_from_two_coarse_bodies_is_nearer_to_that_of_a_fine_one(solid):
    state, data = solid
    module = PhysicsIDModule(HIT, method())
    module.attach(data, Physics(ViscoplasticVonMises(mu=1e4, kappa=1e5, tau_y=1e3), substep_rate=1920.0))
    module.import_state(state.with_(physics={}))
    coarse, pair, fine = OutlineCost(module, 1300), OutlineCost(module, 1300, 500), OutlineCost(module, 8000)
    free = fine.free(module)
    apart = [np.mean((body.residual(free) - fine.residual(free)) ** 2) for body in (coarse, pair)]
    assert apart[1] < apart[0] / 2


def test_a_corrected_body_is_compared_in_pixels_by_its_own_particles(data, state):
    losses = []
    for chosen in (method(), GaussNewton(coarse_iterations=0, pool=1)):
        module = PhysicsIDModule(HIT, chosen)
        module.attach(data, physics())
        module.import_state(state.with_(corrected=True, physics={**state.physics, "E": 4e4}))
        losses.append(module.method.iterate(module, module.configure_optimizers(), 0))
    every_image = module.fixed_views(FRAMES, None)
    prior_terms = ((TRUTH["nu"] - 0.35) / 0.1) ** 2 / sum(map(len, every_image))
    assert losses[0] == pytest.approx(losses[1] * (1 + prior_terms), rel=1e-6)
    module.import_state(state.with_(physics={**state.physics, "E": 4e4}))
    assert losses[1] == pytest.approx(module.loss(FRAMES, every_image).item(), rel=1e-3)


def corrected(data, state, **known: float) -> PhysicsIDModule:
    module = PhysicsIDModule(HIT, method())
    module.attach(data, physics())
    module.import_state(state.with_(corrected=True, physics={**state.physics, **known}))
    return module


def test_what_is_usual_counts_as_much_as_one_image(data, state):
    """Its slope is that of the cost; after the first iteration its weight stays, in the optimiser's state, too."""
    module = corrected(data, state, E=4e4, nu=0.1)
    optimiser, pixels = module.configure_optimizers(), corrected(data, state, E=4e4, nu=0.1)
    pixels.method = GaussNewton(coarse_iterations=0, pool=1)
    of_images = pixels.method.iterate(pixels, pixels.configure_optimizers(), 0)
    assert module.method.iterate(module, optimiser, 0) > of_images
    assert optimiser.param_groups[0]["image_error"] == pytest.approx(of_images, rel=1e-6)

    resumed = corrected(data, state, E=4e4, nu=0.1)
    other = resumed.configure_optimizers()
    other.load_state_dict(optimiser.state_dict())
    resumed.free["E"].data.copy_(module.free["E"])
    resumed.free["nu"].data.copy_(module.free["nu"])
    resumed.velocity.data.copy_(module.velocity)
    assert resumed.method.iterate(resumed, other, 1) == module.method.iterate(module, optimiser, 1)
    assert resumed.method.group["image_error"] == pytest.approx(of_images, rel=1e-6)

    index, step = list(module.free).index("nu"), 1e-3
    _, gradient, hessian = module.method.prior_terms(module)
    losses = []
    for moved in (-step, step):
        with torch.no_grad():
            module.free["nu"] += moved
            losses.append(module.method.prior_terms(module)[0])
            module.free["nu"] -= moved
    assert float(gradient[index]) == pytest.approx((losses[1] - losses[0]) / (4 * step), rel=1e-3)
    assert int((gradient != 0).sum()) == int((hessian != 0).sum()) == 1


def test_without_search_it_starts_from_the_guess(data, state):
    module = PhysicsIDModule(HIT, method(samples=0))
    module.attach(data, physics(E=2e4))
    module.import_state(state.with_(physics={}))
    before = module.export_values()
    module.method.prepare(module)
    assert module.export_values() == before


def test_outlines_that_are_cut_off_are_one_clear_error(data, state):
    video = data.video
    cut = type(data)(
        **{**vars(data), "video": type(video)(**{**vars(video), "silhouettes": torch.ones_like(video.silhouettes)})}
    )
    module = PhysicsIDModule(HIT, method())
    module.attach(cut, physics())
    module.import_state(state)
    with pytest.raises(UserInputError, match="touch the border"):
        module.method.prepare(module)


def test_the_search_covers_the_decades(data, state):
    module = PhysicsIDModule(HIT, method(scan_decades=2.0))
    module.attach(data, physics(E=1e4))
    module.import_state(state.with_(physics={}))
    spans = module.method.span(module)
    assert spans["E"] == (2.0, 6.0)
    assert "v_y" not in spans


@pytest.mark.parametrize("settings", [{"samples": -1}, {"starts": 0}, {"particles": 400}, {"scan_particles": 10}])
def test_impossible_settings_are_refused(settings):
    with pytest.raises(UserInputError, match="OutlineGaussNewton"):
        method(**settings)


def test_no_processes_are_refused_before_any_work():
    with pytest.raises(UserInputError, match="OutlineGaussNewton: jobs = 0; give 1 or more"):
        OutlineGaussNewton(jobs=0)
