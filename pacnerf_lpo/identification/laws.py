"""Which constitutive law a recording shows: laws compete as effects do, each fitted in its own space of parameters.

Every law is searched on a coarse body first. Those that come near the best one there are fitted again to a residual
that is standardised by the noise of the law which explains most (sensor, other grids, errors of the reconstructed
shape), as in a diagnosis. What they leave, and what part of their priors the data leave, are their evidence (Laplace's
approximation); how well they predict held-out views and frames is reported with it.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from scipy.special import softmax

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.base_fit import TOUCH, coarse_search, refined
from pacnerf_lpo.identification.forward_model import VELOCITY, Model
from pacnerf_lpo.identification.model_errors import FORCES
from pacnerf_lpo.identification.multistart import Search, Stage, Watch, multistart
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.replicates import replicates
from pacnerf_lpo.identification.shape_errors import discretisation_errors, shape_errors
from pacnerf_lpo.identification.smooth_force import force_changes
from pacnerf_lpo.identification.standardised import StandardisedObjective, noise_of
from pacnerf_lpo.inference.checks import check_fitted, check_held_out
from pacnerf_lpo.inference.decision import Contender, indistinguishable, log_odds
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.inference.sizes import size_of_errors
from pacnerf_lpo.mpm.materials.auto import Auto
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.common import BULK, POISSON, SHEAR, YIELD, YOUNG

PARTICLES = 2500
"""Of the body on which laws are compared: as many as the quick identification has. The search has fewer still, and if a
body's limbs are there no more than two cells thick, the grid deforms them as much as any law."""
ABORT_ABOVE = 4.0
"""Times the least cost on the coarse body: a law whose residual is twice as large does not catch up on a finer one,
which changes costs by half."""
HALVINGS = 1
"""Of the time step: a body so stiff that it needs a finer one moves as rigidly as one half as stiff."""
SAMPLES = 16
"""Points tried in the space of a law's moduli, at most: fits from them find what two moduli hide; those of a law with
more begin at its relatives, too."""
REPLICATES = 8
"""Of the best law, as in a diagnosis: fewer do not show how errors of one frame go with those of the next."""
ITERATIONS = 10
"""Of a fit on the finer body: it begins near its optimum."""
YIELDS_NOT = 0.3
"""Of Young's modulus: a yield stress that no impact of a body that stays whole reaches."""
POOR = 3.0
"""Times the error of the noise, in what was held out: such an error nobody would overlook."""
LINEARISATIONS = 2
"""Of what that force changes: at the best law alone, and at the best one beside it."""
SEED = 0


@dataclass(frozen=True)
class Trial:
    """What is known of one law.

    law: name of its class;  family: how a person calls it.
    known: every value at its best fit so far, velocity included [SI]; none before it was fitted.
    coarse: mean square of the coarse body's residual at its best fit, in units of what is presumed of its error.
    cost: of the standardised residual, with the priors' terms.
    log_odds: against the best law;  probability: of it among those that were compared.
    held_out: standardised error of what was not fitted, relative to that of the noise; 1 where the law is right.
    left_out: why it was not compared to the end; empty where it was.
    seconds: that it took.
    """

    law: str
    family: str
    known: dict[str, float] | None = None
    coarse: float | None = None
    cost: float | None = None
    log_odds: float | None = None
    probability: float = 0.0
    held_out: float | None = None
    left_out: str = ""
    seconds: float = 0.0


class Competition:
    """Laws that compete to explain one recording. Its steps are taken one by one, and what they found is plain data.

    Args:
        problem: of which the physics' material is :class:`Auto`.

    Attributes:
        trials: by the name of their law, in the order of the laws.
        reference: name of the law that explains most on the coarse body.
        arrays: of the noise, by name; with the ``force``, if the laws were compared beside one.
        alone: the least error of what was held out, in units of its noise, if no law explains that; else None.

    Raises:
        UserInputError: no law suits the effects and the ground.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        material = problem.physics.material
        assert isinstance(material, Auto)
        self.problems: dict[str, Problem] = {}
        self.trials: dict[str, Trial] = {}
        for law in material.guesses(*impact(problem)):
            name = type(law).__name__
            self.trials[name] = Trial(name, law.family or name)
            try:
                self.problems[name] = _of_law(problem, law)
            except UserInputError as error:
                self._leave_out(name, str(error))
        self.reference, self.arrays = "", dict[str, np.ndarray]()
        self.alone: float | None = None
        trials = self.trials.items()
        self._tasks: list[tuple[str, Callable[[Watch], None]]] = [
            *((f"{trial.family}: search", partial(self._search, name)) for name, trial in trials),
            ("noise: the best law", self._refine_best),
            ("noise: other grids", self._replicate),
            ("noise: other shapes", self._disturb),
            *((f"{trial.family}: fit", partial(self._fit, name)) for name, trial in trials),
            ("verdict", self._judge),
            ("an unknown force", self._compare_beside_a_force),
        ]

    @property
    def steps(self) -> int:
        """Number of steps in all: a search for every law, the noise of the best one, a fit for every law that is left,
        the verdict, and another where no law explains the recording.
        """
        return len(self._tasks)

    def describe(self, number: int) -> str:
        """What a step does."""
        return self._tasks[number][0]

    def step(self, number: int, watch: Watch = lambda items, _: items) -> None:
        """Take a step. Raises SimulationError where no law gives a stable motion."""
        self._tasks[number][1](watch)

    @property
    def ranked(self) -> list[Trial]:
        """Trials, the most probable first, those that were left out last."""
        trials = self.trials.values()
        return sorted(trials, key=lambda t: (t.log_odds is None, -(t.log_odds or 0.0), t.coarse or np.inf))

    @property
    def chosen(self) -> Trial:
        """The law that is used: of those that are indistinguishable from the most probable one, the simplest."""
        return next(trial for trial in self.trials.values() if trial in self.indistinguishable)

    @property
    def indistinguishable(self) -> list[Trial]:
        """The most probable law, and those that are indistinguishable from it."""
        odds = {t.law: t.log_odds for t in self.ranked if t.log_odds is not None}
        leader = Contender(next(iter(odds)), 0.0, 0.0, 0.0)
        return [self.trials[name] for name in indistinguishable(leader, odds)]

    def summary(self) -> dict[str, Any]:
        """The table, best law first, the law that is used, and what is to be said of it, as JSON."""
        return {
            "laws": [{**asdict(trial), "parameters": self._parameters(trial)} for trial in self.ranked],
            "chosen": self.chosen.law,
            "indistinguishable": [trial.law for trial in self.indistinguishable],
            "sentences": sentences(self.indistinguishable, self.chosen, self.alone, "force" in self.arrays),
        }

    def _parameters(self, trial: Trial) -> dict[str, dict[str, Any]]:
        """Of the law, as found so far [SI]."""
        known, material = trial.known or {}, self.problems.get(trial.law, self.problem).physics.material
        described = material.parameters.items() if known else ()
        return {name: {"value": known[name], "unit": parameter.unit} for name, parameter in described}

    def found(self) -> dict[str, Any]:
        """All that the steps so far have found, as plain data and tensors."""
        arrays = {name: torch.from_numpy(values) for name, values in self.arrays.items()}
        trials = [asdict(trial) for trial in self.trials.values()]
        return {"trials": trials, "reference": self.reference, "arrays": arrays, "alone": self.alone}

    def restore(self, found: dict[str, Any]) -> None:
        """Take over what :meth:`found` gave."""
        self.trials = {entry["law"]: Trial(**entry) for entry in found["trials"]}
        self.reference, self.alone = found["reference"], found["alone"]
        self.arrays = {name: values.numpy() for name, values in found["arrays"].items()}

    def _search(self, name: str, watch: Watch) -> None:
        """Of its parameters on the coarse body."""
        if self.trials[name].left_out:
            return
        began, problem = time.monotonic(), self.problems[name]
        at = problem, problem.physics.effects, problem.first_guess
        found = coarse_search(*at, watch=watch, most_samples=SAMPLES)
        if not found.fits:
            self._leave_out(name, "its motion is unstable from every start")
            return
        best, model = found.fits[0], problem.coarse_model(problem.physics.effects, problem.first_guess)
        coarse = best.cost / max(len(best.residual) - len(best.free), 1)
        self._note(name, began, known=model.physical(best.free), coarse=coarse)

    def _refine_best(self, _: Watch) -> None:
        """Fit the law that explains most on the coarse body again, on the finer one."""
        while True:
            left = [t for t in self.trials.values() if t.coarse is not None and not t.left_out]
            if not left:
                why = "no law gives a stable motion; check data.box_lower and physics.substep_rate"
                raise SimulationError(0, 0, why)
            self.reference = min(left, key=lambda trial: trial.coarse or 0.0).law
            began, (problem, known) = time.monotonic(), self._at(self.reference)
            try:
                found = refined(problem, problem.physics.effects, known, Search([], 0, 0), followed=True)
            except SimulationError:
                self._leave_out(self.reference, "its motion is unstable on a finer body")
                continue
            self._note(self.reference, began, known=found.known)
            return

    def _replicate(self, watch: Watch) -> None:
        """What the best law may leave; then those that explain much less are left out."""
        try:
            found = replicates(*self._best(), REPLICATES, SEED)
        except SimulationError:
            self._leave_out(self.reference, "its motion is unstable on finer grids")
            self._refine_best(watch)
            self._replicate(watch)
            return
        self.arrays["replicates"], self.arrays["sensor"], self.arrays["bias"] = found
        best = self.trials[self.reference]
        for other, trial in self.trials.items():
            if trial.coarse is not None and best.coarse is not None and trial.coarse > ABORT_ABOVE * best.coarse:
                times = (trial.coarse / best.coarse) ** 0.5
                self._leave_out(other, f"its error on a coarse body is {times:.1f} times that of the {best.family} law")

    def _disturb(self, _: Watch) -> None:
        """What the residual does where shape or resolution are wrong."""
        at = self._best()
        errors = shape_errors(*at), discretisation_errors(*at, self.arrays["bias"])
        self.arrays["errors"] = np.nan_to_num(np.concatenate(errors, axis=-1))

    def _best(self) -> tuple[Problem, Model, np.ndarray]:
        """The best law as functions of the noise want it."""
        problem, known = self._at(self.reference)
        model = problem.model(problem.physics.effects, known)
        return problem, model, np.clip(model.start, *model.bounds)

    def _noise(self, mask: np.ndarray) -> NoiseModel:
        """Of the entries of a mask [(R, F, 11), bool]."""
        found = self.arrays
        errors = [found[name][mask] for name in ("errors", "force") if name in found]
        return noise_of(self.problem, found["replicates"], found["sensor"], mask, np.concatenate(errors, axis=1))

    def _fit(self, name: str, watch: Watch) -> None:
        """Of the standardised residual on the finer body, from where the search ended and from its relatives."""
        if self.trials[name].left_out:
            return
        began, (problem, known) = time.monotonic(), self._at(name)
        model, mask, usable = problem.model(problem.physics.effects, known), problem.fitted, problem.usable
        whole = self._noise(usable)
        noise = whole.among(mask[usable])
        objective = StandardisedObjective(problem, model, mask, noise)
        settings = objective, model.scales, model.bounds, (objective.rows,)
        stages = Stage(*settings), Stage(*settings, iterations=ITERATIONS, confirm=True)
        fits = multistart(stages, [model.start, *self._relatives(name, model)], watch).fits
        if not fits or fits[0].jacobian is None:
            self._leave_out(name, "its motion is unstable on a finer body")
            return
        found = fits[0]
        residual, jacobian = objective.seen(found)
        moved = np.nan_to_num(jacobian) * objective.deviation
        whole = whole.with_directions(moved[usable])
        held = check_held_out(whole, np.nan_to_num(residual[usable]), mask[usable])
        self._note(
            name,
            began,
            known=model.physical(found.free),
            cost=found.cost_of(objective.rows),
            held_out=max(held.times_noise, 0.0) ** 0.5,
        )

    def _relatives(self, name: str, model: Model) -> list[np.ndarray]:
        """Free coordinates at which a law is what other solids were found to be [(K,) each]: their optima, too, are
        starts, for a law that contains another must not do worse.
        """
        law, found = self.problems[name].physics.material, []
        for other, trial in self.trials.items():
            if other != name and trial.known is not None:
                values = as_solid(law, self.problems[other].physics.material, trial.known)
                if values:
                    known = {**model.known, **trial.known, **values}
                    start = [unknown.transform.to_free(known[unknown.name]) for unknown in model.unknowns]
                    found.append(np.clip(start, *model.bounds))
        return found

    def _judge(self, _: Watch) -> None:
        """Odds of the laws by what each leaves, in units of the dispersion of the best, in the fitted or the held-out
        data, whichever is larger, and of left-out replicates.

        The flexibility of a law costs no odds, as it does among effects: a yield stress that is never met can be large
        or larger, which the slope at one value of it does not show. The rule that the simplest is used takes its place.
        """
        left = {name: trial for name, trial in self.trials.items() if trial.cost is not None}
        contenders = [Contender(n, t.cost or 0.0, 0.0, 0.0) for n, t in left.items()]
        noise = self._noise(self.problem.fitted)
        scale = max(1.0, float(np.mean(check_fitted(noise, noise.mean).replicates))) ** 0.5
        best, size = min(left.values(), key=lambda trial: trial.cost or 0.0), int(self.problem.fitted.sum())
        beyond = (best.held_out or 0.0) / max(1.0, (best.cost or 0.0) / size) ** 0.5
        odds = log_odds(contenders, size, max(scale, beyond))
        for (name, found), share in zip(odds.items(), softmax(list(odds.values())), strict=True):
            self.trials[name] = replace(self.trials[name], log_odds=found, probability=float(share))

    def _compare_beside_a_force(self, watch: Watch) -> None:
        """Where no law explains what was held out, something else acts, and a law that dissipates energy stands in for
        it. So the laws are compared once more, beside a smooth force of which nothing is known, as large as it has to
        be; a second time with what it changes where the first has ended, if the best one then predicts more.
        """
        leader = self.ranked[0]
        if leader.held_out is None or leader.held_out <= POOR:
            return
        self.alone = least = leader.held_out
        before = dict(self.trials), dict(self.arrays)
        for _ in range(LINEARISATIONS):
            problem, known = self._at(self.ranked[0].law)
            try:
                changes = force_changes(problem, problem.physics.effects, known, lambda _: None)
            except SimulationError:  # of the coarse body; what was found so far stays
                return
            self.arrays.pop("force", None)
            model, mask = problem.model(problem.physics.effects, known), problem.fitted
            residual, noise = problem.residual(model.predict(model.start)), self._noise(mask)
            self.arrays["force"] = size_of_errors(noise, residual[mask], changes[mask], FORCES) * changes
            for name in self.trials:
                self._fit(name, watch)
            self._judge(watch)
            left = self.ranked[0].held_out or 0.0
            if left > least:
                self.trials, self.arrays = before
                return
            least, before = left, (dict(self.trials), dict(self.arrays))

    def _at(self, name: str) -> tuple[Problem, dict[str, float]]:
        """The problem of a law, and every value at its best fit so far [SI]."""
        known = self.trials[name].known
        assert known is not None
        return self.problems[name], known

    def _note(self, name: str, began: float, **found: Any) -> None:
        trial = self.trials[name]
        self.trials[name] = replace(trial, seconds=trial.seconds + time.monotonic() - began, **found)

    def _leave_out(self, name: str, why: str) -> None:
        self.trials[name] = replace(self.trials[name], left_out=why)


def sentences(left: Sequence[Trial], chosen: Trial, alone: float | None = None, forced: bool = False) -> list[str]:
    """What a person should know of the choice, where the ``left`` laws are not separated, the most probable first;
    ``alone`` as of :class:`Competition`, ``forced``: whether the laws were compared beside an unknown force.
    """
    leader = left[0]
    if len(left) > 1:
        named = [f"{trial.family} ({trial.law})" for trial in left]
        found = [
            f"The recording does not separate these laws: {', '.join(named[:-1])} and {named[-1]}. The simplest is "
            f"used: {chosen.family}; intervals of its parameters hold if it is the right one."
        ]
    else:
        found = [f"The material is {chosen.family} ({chosen.law}), with probability {_percent(chosen.probability)}."]
    if alone is not None:
        beside = f", and {leader.held_out:.1f} times beside an unknown smooth force" if forced else ""
        found.append(
            f"Doubtful: the best law alone predicts what was held out with {alone:.1f} times the error of the noise"
            f"{beside}. Something else may be missing: run pacnerf-lpo diagnose, and check masks and ground"
        )
    return found


def as_text(summary: Mapping[str, Any]) -> str:
    """What :meth:`Competition.summary` gave, for a terminal: a line for every law, then what is to be said."""
    lines = []
    for trial in summary["laws"]:
        said = f"left out: {trial['left_out']}"
        if not trial["left_out"]:
            said = f"probability {_percent(trial['probability'])}, held-out error {trial['held_out']:.2f} x noise"
        lines.append(f"{trial['family']:<13} {said}")
    return "\n".join([*lines, *summary["sentences"]])


def _percent(probability: float) -> str:
    return "more than 99.9 %" if probability > 0.999 else f"{100 * probability:.1f} %"


def as_solid(law: Material, other: Material, known: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a solid at which it is nearest to another one with known ones [SI]; none where one of them is no
    elastic solid.
    """
    if SHEAR.name in known and SHEAR in other.parameters.values():
        mu, kappa = known[SHEAR.name], known[BULK.name]
        young, poisson = 9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (6 * kappa + 2 * mu)
    elif YOUNG in other.parameters.values():
        young, poisson = known[YOUNG.name], known[POISSON.name]
        mu, kappa = young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))
    else:
        return {}
    least, most = (0.99 * bound for bound in POISSON.bounds)
    moduli = {YOUNG: young, POISSON: min(max(poisson, least), most), SHEAR: mu, BULK: kappa, YIELD: YIELDS_NOT * young}
    found = {p.name: value for p, value in moduli.items() if p in law.parameters.values()}
    if not (SHEAR.name in found or YOUNG.name in found):
        return {}
    shared = {n: v for n, v in known.items() if n in law.parameters and law.parameters[n] == other.parameters.get(n)}
    return {**law.guess, **found, **shared, **{name: law.guess[name] for name in law.known}}


def impact(problem: Problem) -> tuple[float, float]:
    """Pressure of an impact [Pa], density times the square of its speed, and the time in which the body passes its own
    size at that speed [s]: by free fall from frame 0 to the first contact, at least from its own height.
    """
    physics, known, times = problem.physics, problem.first_guess, problem.video.times
    model = problem.coarse_model((), known)
    contact = min(model.contact(model.start, TOUCH), len(times) - 1)
    fallen = float(times[contact] - times[0])
    velocity = [known[p.name] + fallen * g for p, g in zip(VELOCITY, physics.gravity, strict=True)]
    size, gravity = problem.body.volume ** (1 / 3), float(np.linalg.norm(physics.gravity))
    speed = max(float(np.linalg.norm(velocity)), (gravity * size) ** 0.5)
    return physics.rho * speed**2, size / speed


def _of_law(problem: Problem, law: Material) -> Problem:
    """The same problem with another law. Raises UserInputError where effects or ground do not suit it."""
    found = copy(problem)
    found.physics = problem.physics.of(law)
    found.physics.most_halvings = HALVINGS
    vars(found).pop("first_guess", None)
    return found
