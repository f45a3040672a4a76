"""What the residual does where body, resolution or opacity are wrong: directions of the noise, in addition to what
replicates show.

A few replicates show the size of such errors, but hardly any of their directions. So each of some smooth errors of the
shape and of the density is tried once, by as much as it may be wrong.
"""

from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model, outcome, with_effects
from pacnerf_lpo.identification.problem import Part, Problem
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.identification.replicates import distortion
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.effects.kelvin_voigt import KelvinVoigt

LARGER = 1.5
"""Radius of the discs of a spray relative to the model's, in which particles next to each other leave no gap."""
MORE_STEPS = 4
"""Times as many steps as the model. Each of them dissipates a little, as a viscosity would, and how many another code
takes depends on its user: for the scenes of the paper, 2,400 to 25,000 a second."""
OWN_VISCOSITY = 0.025
"""Viscosity that a solid may have from its solver, in units of rho h^2 / dt: what so many more steps add, on average of
three bodies (`python -m validation.solver_error`)."""
TOLD = 10
"""A line of progress is written after so many simulations."""


def shape_errors(problem: Problem, model: Model, free: np.ndarray, progress: Progress = lambda _: None) -> np.ndarray:
    """Changes of the residual [pixels, (V, F, 11, 2 M)] by errors of the body, each of one standard deviation, by one
    simulation each; none where its shape is known. An error with which the motion is unstable is left out.

    What an error of the shape changes depends on the resolution, where the body meets the ground, and a recorded body
    has none: so half of the variance is of the model's body and half of the coarse one.

    Args:
        model, free: whose body may be wrong, and coordinates at which it was fitted [(K,)]

    Raises:
        SimulationError: the motion is unstable with every one of them.
    """
    reference = model.predict(free)
    parts = problem.parts(model.effects, model.physical(free))
    found = [_of_recording(part, problem.part_of(reference, n), progress) for n, part in enumerate(parts)]
    return of_each(problem, found)


def measuring_errors(problem: Problem, effects: Sequence[Effect], known: dict[str, float]) -> np.ndarray:
    """Changes of the residual by what may be wrong with the measurement of each recording as a whole, of one standard
    deviation each [(R, F, 11, M')].
    """
    return of_each(problem, [part.recording.measuring_errors for part in problem.parts(effects, known)])


def discretisation_errors(problem: Problem, model: Model, free: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Changes of the residual of each recording [(R, F, 11, 3 to 5 for each)] when its body is coarser, takes more
    steps, and, of a solid, is more viscous, and, where cameras show it, when its particles are larger, and the bias of
    a wrong shape; none of a body that is rigid.

    The error of a method of order p at node spacing h is C h^p, and the step to 1.4 h changes it by (1.4^p - 1) C h^p:
    the whole error for p = 2, two fifths of it for p = 1. Replicates, with 0.6 h to 0.9 h, show a quarter and more.

    How much a solver dissipates follows from its number of steps, which of a recorded body, or of the code that has
    simulated it, nobody knows. Replicates take a few more than the model, not :data:`MORE_STEPS` times as many. Other
    codes dissipate in other ways than this one does with more steps; what they have in common is a viscosity.

    How large a particle is drawn does not matter while the body stays whole, as residuals are relative to frame 0. The
    outline of what was inside and comes to the surface, and of a spray, depends on it.

    Args:
        model, free: as for :func:`shape_errors`.
        bias: what a wrong shape changes on average, from :func:`~.replicates.replicates` [(R, F, 11)]

    Raises:
        SimulationError: the motion of the coarse body, or with shorter steps, is unstable.
    """
    reference, changes = model.predict(free), []
    for number, part in enumerate(problem.parts(model.effects, model.physical(free))):
        if not part.recording.deforms:
            changes.append(np.zeros((*part.recording.usable.shape, 0)))
            continue
        others = [part.recording.coarse_model(part.effects, part.known), *_dissipating(part)]
        if part.recording.views:
            others.append(part.model)
            others[-1].footprint = LARGER
        own = problem.part_of(reference, number)
        seen = [part.recording.relative(other.predict(other.start) - own) for other in others]
        changes.append(np.stack([*seen, problem.part_of(bias, number)], axis=-1))
    return of_each(problem, changes)


def _dissipating(part: Part) -> list[Model]:
    """Models of a recording that dissipate more: by more steps, and, if it is a solid, by a viscosity."""
    recording, effects, known = part.recording, part.effects, part.known
    often = recording.model(effects, known)
    physics = often.physics
    often.physics = with_effects(physics, effects, 1 / MORE_STEPS, 1.0)
    if not KelvinVoigt.suits(physics.material):
        return [often]
    (name,) = KelvinVoigt.parameters
    if name not in known:
        effects, known = (*effects, KelvinVoigt()), {**known, name: 0.0}  # type: ignore[call-arg]
    own = OWN_VISCOSITY * physics.rho * recording.spacing**2 * physics.substep_rate
    return [often, recording.model(effects, {**known, name: known[name] + own})]


def of_each(problem: Problem, changes: Sequence[np.ndarray]) -> np.ndarray:
    """Changes of the residual of every recording, each by causes of its own [(R', F', 11, M') each], as changes of the
    whole residual by all of them [(R, F, 11, M)].
    """
    columns = []
    for number, own in enumerate(changes):
        others = [np.zeros((*other.shape[:3], own.shape[3])) for other in changes]
        columns.append(problem.join([*others[:number], own, *others[number + 1 :]]))
    return np.concatenate(columns, axis=-1)


def _of_recording(part: Part, reference: np.ndarray, progress: Progress) -> np.ndarray:
    problem, changes = part.recording, []
    sigma = distortion(problem, reference)
    for where, body in (("", problem.body), (" on a coarse body", problem.coarse_body)):
        bodies = problem.wrong_bodies(body, sigma)
        if not bodies:
            return np.zeros((*problem.usable.shape, 0))
        right = problem.model(part.effects, part.known, body)
        base = right.predict(right.start)
        seen: list[np.ndarray | SimulationError] = []
        for found in each(outcome, ((problem.model(part.effects, part.known, wrong),) for wrong in bodies)):
            seen.append(found)
            if len(seen) % TOLD == 0:
                progress(f"errors that the shape of {problem.scene} may have{where}: {len(seen)} of {len(bodies)}")
        unstable = [found for found in seen if isinstance(found, SimulationError)]
        if len(unstable) == len(seen):
            raise unstable[0]
        stable = [found if isinstance(found, np.ndarray) else base for found in seen]
        changes += [problem.relative(found - base) / 2**0.5 for found in stable]
    return np.stack(changes, axis=-1)
