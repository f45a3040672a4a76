"""Doubts about what was identified: velocity, physical parameters, and how the search for them ended."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import Any

import numpy as np

from pacnerf_lpo.evaluation.doubts.doubt import Doubt
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.mpm.parameters import Log10, Parameter, Saturated
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT, Physics
from pacnerf_lpo.quantities import published, quantity, symbol
from pacnerf_lpo.types import ParticleState

NEAR_BOUND = 0.02
"""Of the width of an interval: a Poisson's ratio so close to the end of its transform hardly moves with the coordinate
in which it is optimised, so that nothing stopped it but the bound. For other parameters it is a noticeable change."""
HALF_LATTICE = 0.25
"""Decades, half the distance of two points of the search: an optimum nearer to its end was not enclosed."""
FAR = 3.0
"""Standard deviations from the prior mean, or from the guess where there is no prior: one value in 370 by chance."""
SEEN_STEP = 1.0
"""Pixels by which a velocity that is still moving displaces the body at the contact: less is not seen in an image."""
WINDOW = 0.1
"""Part of the iterations whose mean cost is compared, where single ones differ by the choice of views."""
CHANCE = 3.0
"""Standard errors by which two such means differ by chance, once in 370 runs."""
VISIBLE_RISE = 0.1
"""Part of the cost: an end that is so much above the best iteration has left an explanation that is seen."""
QUARTER = 4
"""The parameters still move if their mean over the last quarter of the iterations is a noticeable change
(``Parameter.scale``) away from that over the quarter before: as many iterations more would change the answer."""
DIFFERENT = 2.0
"""Noticeable changes (``Parameter.scale``) between the two answers, one for each of them."""
OPEN_VOLUME = 0.03
"""Of the volume: a stiffness that follows it is wrong by a third of what its interval usually allows."""


def doubts_about_velocity(
    course: Mapping[str, Any], state: ParticleState, pixel: float, seconds: float
) -> Iterator[Doubt]:
    """The initial velocity still moved when its iterations ended. ``pixel``: its size at the body [m];
    ``seconds``: from frame 0 to the contact.
    """
    moved = course.get("last_step", 0.0)
    if moved * seconds > SEEN_STEP * pixel:
        yield Doubt(
            "velocity_moving",
            "phases.velocity",
            f"the velocity, {state.velocity.mean(0).norm():.3g} m/s, still moved by {moved:.2g} m/s in its last "
            f"iteration, {1000 * moved * seconds:.0f} mm at the contact",
            "too few iterations, a hit_frame after the contact, or frames at another rate than physics.frame_rate",
            "raise phases.velocity.init_args.max_iterations, or check hit_frame and frame rate",
        )


def doubts_about_parameters(
    physics: Physics, state: ParticleState, searched: Mapping[str, Sequence[float]]
) -> Iterator[Doubt]:
    """Identified parameters at a bound, far from the prior mean, or physically odd, in the state that an identification
    exported; ``searched``: between which free coordinates parameters were searched, by name.
    """
    nulls = {name: null for effect in physics.effects for name, null in effect.null.items()}
    for name in physics.free_names:
        parameter, value = physics.parameters[name], state.physics.get(name)
        if value is None:
            continue
        if name == "nu" and value < 0:
            yield Doubt(
                "negative_poisson",
                "physics, nu",
                f"Poisson's ratio = {value:.3g} is below 0, as hardly any solid's is",
                "it makes up for an error of the ground, the velocity, the shape or the law, or the impact is too weak "
                "to show it",
                "check the ground and the velocity, look at `pacnerf-lpo diagnose`, or hold nu at a usual value "
                "(physics.material.known: [nu])",
            )
        elif name == GROUND_HEIGHT.name:
            away, error = abs(value - physics.ground_height), physics.ground_error
            # a grid shifts the contact by half a cell; a fitted height may make up for that
            if away > state.spacing / 2 + error:
                yield Doubt(
                    "ground_moved",
                    "physics, ground_height",
                    f"the identified ground, {value:.3f} m, is {1000 * away:.0f} mm from where it was said to be, more "
                    f"than half a cell ({500 * state.spacing:.0f} mm)"
                    + (f" and the error of its measurement ({1000 * error:.0f} mm)" if error else ""),
                    "the ground lies elsewhere, or the height makes up for a wrong velocity",
                    "measure the ground and set physics.ground_height; physics.ground_error says how exact that is",
                )
        else:
            found = chain(
                _at_material_bound(parameter, value, nulls.get(name)),
                _at_search_bound(parameter, value, searched.get(name)),
                _far_from_prior(parameter, value, physics.guess[name]),
            )
            yield from islice(found, 1)  # the first of these that is so


def doubts_about_intervals(
    physics: Physics, identified: Mapping[str, float], fit: Mapping[str, Any]
) -> Iterator[Doubt]:
    """Outlines leave the shape open, what the weighted fit leaves is no noise, or what the identification before it had
    [SI] lies outside of its interval, and farther away than a fit that does not know its weights would be.

    ``fit``: ``open_volume``; ``p_value`` of what it leaves; ``parameters``: ``low`` and ``high`` of those that were
    estimated [SI], whether each is ``determined``, and between which ends a fit of ``equal_weights`` is expected, by
    name.
    """
    if fit.get("open_volume", 0.0) > OPEN_VOLUME:
        yield Doubt(
            "open_shape",
            "data.train_views",
            f"the outlines leave {fit['open_volume']:.0%} of the body's volume open (one standard deviation)",
            "there are few cameras, or all of them look down at the body: none sees its underside, or a face edge-on",
            "film from more sides, and from as low as the ground allows; until then the intervals allow for it",
        )
    if fit.get("p_value", 1.0) < LEVEL:
        yield Doubt(
            "not_noise",
            "physics",
            f"the weighted fit leaves more of the outlines than its errors explain (p = {fit['p_value']:.2g})",
            "the shape was reconstructed wrongly, the ground lies elsewhere, or law or effects are not the right ones",
            "do not rely on the intervals; use more views or a finer resolution, and let `pacnerf-lpo diagnose` name "
            "what is missing",
        )
    outside = []
    for name in physics.free_names:
        interval, unit = fit["parameters"].get(name), physics.parameters[name].unit
        if name == GROUND_HEIGHT.name or name not in identified or interval is None or not interval["determined"]:
            continue
        low, high = published(interval)
        least, most = interval.get("equal_weights", (low, high))
        if not min(low, least) <= identified[name] <= max(high, most):
            value, *ends = (quantity(one, unit) for one in (identified[name], low, high))
            outside.append(f"{symbol(name)} = {value} (interval {' to '.join(ends)})")
    if outside:
        yield Doubt(
            "outside_interval",
            "physics",
            f"the identification before the weighted fit had {' and '.join(outside)}",
            "the identification ended in another minimum than the best, by images perhaps as shading pulled "
            "colours; or an error of the coarse grid, the shape or the ground is larger than the interval says",
            "believe the weighted fit where the mattes are good; state the ground where it is known (init "
            "--ground), and repeat at a finer resolution (a smaller phases.static.init_args.base_spacing)",
        )


def doubts_about_identification(course: Mapping[str, Any], physics: Physics) -> Iterator[Doubt]:
    """The cost rose, or the iterations ended while parameters were still moving."""
    yield from _risen(course)
    if course.get("converged", True):
        return
    for name, visited in course["visited"].items():
        width = -(-len(visited) // QUARTER)
        moved = abs(np.mean(visited[-width:]) - np.mean(visited[-2 * width : -width])) if len(visited) > 1 else 0.0
        parameter = physics.parameters[name]
        if moved > parameter.scale:
            factor = f"a factor of {10**moved:.2g}" if isinstance(parameter.transform, Log10) else f"{moved:.2g}"
            yield Doubt(
                "still_moving",
                f"physics, {name}",
                f"{parameter.label} still moved by {factor} in the last of {len(visited) - 1} iterations",
                "too few iterations",
                "raise the iterations of phases.physics.init_args.method, or start from this value",
            )


def _at_material_bound(parameter: Parameter, value: float, null: float | None) -> Iterator[Doubt]:
    """At an end of the interval that the model allows, unless that is where an effect vanishes."""
    low, high = parameter.bounds
    if isinstance(parameter.transform, Saturated):
        ends = [end for end in (low, high) if abs(value - end) < NEAR_BOUND * (high - low)]
    else:
        free, reached = parameter.transform.to_free, parameter.scale
        ends = [end for end in (low, high) if abs(free(value) - free(end)) < reached]
    ends = [end for end in ends if null is None or abs(end - null) > parameter.scale]
    if ends:
        yield Doubt(
            "material_bound",
            f"physics, {parameter.name}",
            f"{parameter.label} = {parameter.show(value)} is at the bound that the model gives it, "
            f"{parameter.show(ends[0])}",
            "the model lacks something that this parameter makes up for, or the video does not determine it",
            "look at `pacnerf-lpo diagnose`, or hold it at a known value (physics.material.known)",
        )


def _at_search_bound(parameter: Parameter, value: float, searched: Sequence[float] | None) -> Iterator[Doubt]:
    if searched is None or not isinstance(parameter.transform, Log10):
        return
    low, high = searched
    if not low + HALF_LATTICE < parameter.transform.to_free(value) < high - HALF_LATTICE:
        ends = [parameter.show(10.0**end) for end in (low, high)]
        yield Doubt(
            "search_bound",
            f"physics, {parameter.name}",
            f"{parameter.label} = {parameter.show(value)} is at the end of the search, {ends[0]} to {ends[1]}",
            "the guess is too far off, or the video does not determine it: a body that does not deform may be any "
            "stiffer",
            f"repeat with {parameter.show(value)} as the guess, or a larger scan_decades; if it runs on, it is not "
            "determined",
        )


def _far_from_prior(parameter: Parameter, value: float, guess: float) -> Iterator[Doubt]:
    mean, deviation = parameter.prior(guess)
    away = abs(parameter.transform.to_free(value) - mean) / deviation
    if not np.isfinite(away) or away <= FAR:
        return
    known = parameter.prior_value
    start = f"the prior mean {known[0]:g}" if known else f"the guess, {parameter.show(guess)}"
    yield Doubt(
        "far_from_prior",
        f"physics, {parameter.name}",
        f"{parameter.label} = {parameter.show(value)} is {away:.1f} standard deviations from {start}",
        "the video hardly determines it, or the law is another one" if known else "the guess, or the unit of a length",
        "hold it at a known value (physics.material.known)" if known else "check the guess and the scale of the scene",
    )


def _risen(course: Mapping[str, Any]) -> Iterator[Doubt]:
    costs = np.array(course.get("costs", ()))
    if len(costs) < 2:
        return
    width = max(1, round(WINDOW * len(costs))) if course["draws_views"] else 1
    means = np.convolve(costs, np.full(width, 1 / width), "valid")
    scatter = float(np.sqrt(np.mean(np.diff(costs, 2) ** 2) / 6)) if len(costs) > 2 else 0.0  # without a trend
    error = CHANCE * scatter * (2 / width) ** 0.5 if course["draws_views"] else 0.0
    first, last, best = means[0], means[-1], int(means.argmin())
    if last > first + max(error, 1e-9):
        seen = f"the cost rose from {first:.4g} to {last:.4g}"
    elif last > means[best] * (1 + VISIBLE_RISE) + error:
        seen = f"the cost ended at {last:.4g}, after {means[best]:.4g} in iteration {best + 1} of {len(costs)}"
    else:
        return
    yield Doubt(
        "cost_rose",
        "phases.physics",
        seen,
        "steps that are too long, or a guess in another local minimum",
        "lower the learning rates, or use the method GaussNewton or OutlineGaussNewton",
    )


def doubts_about_methods(methods: Mapping[str, Any] | None, physics: Physics) -> Iterator[Doubt]:
    """Two methods that were compared on a coarse body differ by more than a noticeable change of each answer."""
    if methods is None:
        return
    for name, by_images in methods.get("images", {}).items():
        parameter, by_outlines = physics.parameters[name], methods["outlines"][name]
        apart = abs(parameter.transform.to_free(by_images) - parameter.transform.to_free(by_outlines))
        if name != GROUND_HEIGHT.name and apart > DIFFERENT * parameter.scale:
            excess = methods["excess"]
            yield Doubt(
                "methods_differ",
                f"physics, {name}",
                f"on a coarse body of {methods['particles']} particles, images give {parameter.show(by_images)} and "
                f"outlines {parameter.show(by_outlines)}; each costs {excess['images']:.3g} % and "
                f"{excess['outlines']:.3g} % more at the answer of the other",
                "shading that changes along the fall pulls colours, or the outlines are wrong or show too little",
                "believe outlines where the light comes from one side and mattes are good (as `quick` does; --config "
                "cpu_outlines), images where mattes are poor or the body has a strong texture",
            )
