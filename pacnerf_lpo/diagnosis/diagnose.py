"""The rounds of a diagnosis: compare, localise, screen, refit, until nothing more is missing."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

from pacnerf_lpo.diagnosis import localising
from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of, read_candidates, whole_catalogue
from pacnerf_lpo.diagnosis.comparison import Comparison, compare, estimate, intervals
from pacnerf_lpo.diagnosis.competition import MOST_AGAIN, Competition
from pacnerf_lpo.diagnosis.profiles import profile
from pacnerf_lpo.diagnosis.refitting import Refit, better_null
from pacnerf_lpo.diagnosis.removal import Without, newest_is_needed, without_each
from pacnerf_lpo.diagnosis.residual_force import residual_force
from pacnerf_lpo.diagnosis.rounds import Round, leaves_more, unknown_wins
from pacnerf_lpo.diagnosis.run_problem import problem_of_runs
from pacnerf_lpo.diagnosis.screening import judge, probe
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.model_errors import FORCES
from pacnerf_lpo.identification.problem import PARTICLES, Problem
from pacnerf_lpo.identification.processes import Progress, check_jobs, prefixed
from pacnerf_lpo.inference.decision import best, indistinguishable, log_odds
from pacnerf_lpo.mpm.effects.base import Effect

Step = Literal["compare", "localise", "screen", "refit"]
LEAST_REPLICATES, MOST_REPLICATES = 4, 200


@dataclass
class Options:
    """Settings of a diagnosis.

    candidates: YAML list of the effects to try; None: all that the package knows.
    replicates: simulated nulls, 8 to 24.
    effects: at most so many are added.
    until: last step to do; of the first round only, unless it is refit.
    seed: of the replicates.
    particles: the body is sampled by about so many.
    profile: an unknown whose interval is found by profile likelihood at the end, too.
    tracks: CSV of tracked points, and
    clouds: folder of point clouds, in place of the run's own; None: as the run has them.
    images: False: only points are compared.
    jobs: processes at once; None: as many as torch may use threads, at most 8.
    per_recording: names of the classes of effects that every recording of a study has for itself.
    """

    candidates: str | None = None
    replicates: int = 20
    effects: int = 3
    until: Step = "refit"
    seed: int = 1
    particles: int = PARTICLES
    profile: str | None = None
    tracks: str | None = None
    clouds: str | None = None
    images: bool = True
    jobs: int | None = None
    per_recording: list[str] = field(default_factory=list)


def prepare(
    run_dirs: Sequence[str | Path], stem: str | None, options: Options, out: str | None = None
) -> tuple[Problem, Store]:
    """What is under diagnosis, and where its results are kept, after every check that needs no long work.

    Args:
        run_dirs: a run, or several of one object.
        stem: phase of the runs; None: the last before a correction.
        options: of the diagnosis.
        out: where the results go, into a folder of that name; None: the run, if it is one.

    Raises:
        UserInputError: no such run or phase, too few views, an unknown effect in the list of candidates, or runs that
            are no study of one object.
    """
    if not LEAST_REPLICATES <= options.replicates <= MOST_REPLICATES:
        raise UserInputError(
            f"diagnose: replicates = {options.replicates}; give {LEAST_REPLICATES} to {MOST_REPLICATES}, 8 to 24 are "
            "enough"
        )
    check_jobs(options.jobs, "diagnose")
    if options.particles < 300:
        raise UserInputError(f"diagnose: particles = {options.particles}; give at least 300, 4000 are a good number")
    if out is None and len(run_dirs) > 1:
        raise UserInputError("diagnose: several runs are a study; give a folder for its results with --out")
    points, divided = (options.tracks, options.clouds), options.per_recording
    problem, fingerprint = problem_of_runs(run_dirs, stem, options.particles, points, options.images, divided)
    check(problem, options)
    what = {k: v for k, v in asdict(options).items() if k in ("replicates", "seed", "particles")}
    listed = None if options.candidates is None else Path(options.candidates).read_text()
    return problem, Store(Path(out or run_dirs[0]) / FOLDER, fingerprint, what, listed)


def investigate(
    problem: Problem,
    store: Store,
    options: Options,
    progress: Progress,
    keep: Callable[[list[Round], bool], None] = lambda *_: None,
) -> list[Round]:
    """All rounds. At the end, an effect that a later model does without is removed; or each but the last one competes
    again beside those that were found after it, which were not there when it was chosen.

    Args:
        problem: what is under diagnosis.
        store: of the results.
        options: of the diagnosis.
        keep: called with the rounds so far after each of them, and whether they are all.

    Raises:
        SimulationError: the motion is unstable at every start.
    """
    return _Diagnosis(problem, store, options, progress, keep).run()


@dataclass
class _Diagnosis:
    """A diagnosis on its way; fields as of :func:`investigate`."""

    problem: Problem
    store: Store
    options: Options
    progress: Progress
    keep: Callable[[list[Round], bool], None]
    rounds: list[Round] = field(default_factory=list)

    def run(self) -> list[Round]:
        """All rounds."""
        problem, store, options, rounds = self.problem, self.store, self.options, self.rounds
        self._add_effects()
        changed = len(rounds) > 2
        while changed:
            looks = without_each(problem, rounds[-1])
            gone = [look for look in looks if look.superfluous]
            changed = self._remove(gone) if gone else self._choose_again(looks)
        last = rounds[-1]
        if options.until == "refit":
            self._estimate(last)
            if unknown_wins(last) or leaves_more(last):
                asked = partial(residual_force, problem, last.effects, last.comparison, FORCES[1])
                last.force = store.once(f"{len(rounds)}_force", asked)
        if options.profile is not None:
            told = prefixed(self.progress, "profile likelihood: ")
            followed = partial(profile, problem, last.effects, last.best, options.profile, told)
            last.profiles[options.profile] = store.once(f"{len(rounds)}_profile_{options.profile}", followed)[:2]
        self.keep(rounds, True)
        return rounds

    def _estimate(self, last: Round) -> None:
        """Fit the model that the rounds have ended with to all data."""
        number = _number(len(self.rounds), last.again, self.rounds, last.beside)
        told = prefixed(self.progress, "estimate from all data: ")
        step = partial(estimate, self.problem, last.effects, last.comparison, told)
        try:
            last.estimate = self.store.once(f"{number}_estimate", step)
        except SimulationError as error:
            told(f"the values are those of the fit to a part of them ({error})")
            return
        last.parameters, last.undetermined = intervals(self.problem, last.effects, last.estimate)
        last.spend("estimate", self._effort([f"{number}_estimate"], last.estimate.rollouts))

    def _remove(self, gone: Sequence[Without]) -> bool:
        """Another round without some effects; whether several are left."""
        rounds, last = self.rounds, self.rounds[-1]
        kept = tuple(effect for effect in last.effects if effect not in [look.effect for look in gone])
        told = prefixed(self.progress, f"round {len(rounds) + 1}, without what is not needed, ")
        names = [look.name for look in gone]
        try:
            found = self._round(kept, gone[-1].known, told, last.again, compete=False)
        except SimulationError as error:
            last.left_out |= dict.fromkeys(names, str(error))
            return False
        found.removed = names
        rounds.append(found)
        return len(kept) - len(self.problem.physics.effects) > 1

    def _choose_again(self, looks: Sequence[Without]) -> bool:
        """In the place of each effect but the last, let all compete beside the others; where another one wins that was
        not removed before, it takes its place. Nothing stands for the fault of a camera. Returns whether one has won.
        """
        rounds, last = self.rounds, self.rounds[-1]
        gone = {name for done in rounds for name in done.removed}
        effects = [look for look in looks if "@" not in look.name]
        for look in effects[:-1]:
            others = tuple(effect for effect in last.effects if effect is not look.effect)
            told = prefixed(self.progress, f"round {len(rounds) + 1}, in the place of {look.name}, ")
            try:
                found = self._round(others, look.known, told, last.again, look.name)
                while found.better is not None and found.again < MOST_AGAIN:
                    found = self._round(others, found.better, told, found.again + 1, look.name)
                chosen = found.accepted
                if chosen is None or chosen.name in gone or look.name in found.indistinguishable:
                    first = next(done for done in rounds if done.accepted and done.accepted.name == look.name)
                    first.indistinguishable = list(dict.fromkeys([look.name, *found.indistinguishable]))
                    first.second = found
                    continue
                after, new = [*rounds, found], found.candidate(chosen.name).effect
                compared = self._round((*others, new), chosen.known, told, found.again, look.name, after, compete=False)
            except SimulationError:
                continue
            found.removed = [look.name]
            rounds[:] = [*after, compared]
            return True
        return False

    def _add_effects(self) -> None:
        """Rounds in which effects are added one after the other."""
        problem, rounds = self.problem, self.rounds
        effects, known = tuple(problem.physics.effects), problem.first_guess
        again, examined = 0, None
        while len(rounds) <= self.options.effects:
            told = prefixed(self.progress, f"round {len(rounds) + 1}, ")
            try:
                found = self._compared(effects, known, told, again, "", rounds)
                if self._confirmed(found, told):
                    rounds.append(self._examined(found, rounds, told))
                else:
                    self._take_back(found, told)
            except SimulationError as error:
                if examined is not None:  # the better optimum cannot be
                    (effects, known), examined, again = examined, None, MOST_AGAIN
                    continue
                if not rounds:
                    raise
                self._take_back(error, told)
            last, examined = rounds[-1], None
            better = better_model(problem, rounds) if again < MOST_AGAIN else None
            if better is not None:
                place, known = better
                effects, again = rounds[place].effects, again + 1
                examined = effects, rounds[place].comparison.known
                del rounds[place:]
                self.progress(
                    f"round {place + 1} begins again: a fit with one more effect led to a better one without it"
                )
                continue
            self.keep(rounds, False)
            if self.options.until != "refit" or (last.accepted is None and not self._widened()):
                break
            last = rounds[-1]
            assert last.accepted is not None
            effects, known = (*last.effects, last.candidate(last.accepted.name).effect), last.accepted.known

    def _round(
        self,
        effects: tuple[Effect, ...],
        known: dict[str, float],
        progress: Progress,
        again: int,
        beside: str = "",
        before: Sequence[Round] | None = None,
        compete: bool = True,
    ) -> Round:
        """The next round; arguments as of :meth:`_compared` and :meth:`_examined`."""
        before = self.rounds if before is None else before
        found = self._compared(effects, known, progress, again, beside, before)
        return self._examined(found, before, progress, compete)

    def _compared(
        self,
        effects: tuple[Effect, ...],
        known: dict[str, float],
        progress: Progress,
        again: int,
        beside: str,
        before: Sequence[Round],
    ) -> Round:
        """The beginning of a round after those before it: its model, with these effects, fitted from known values [SI]
        and compared with the recording; ``again`` and ``beside`` as of a :class:`Round`.
        """
        problem, store, options = self.problem, self.store, self.options
        number = _number(len(before) + 1, again, before, beside)
        settings, told = (options.replicates, options.seed), prefixed(progress, "compare: ")
        searched = not before and not again
        step = partial(compare, problem, effects, known, settings, searched, told)
        comparison: Comparison = store.once(f"{number}_compare", step, of_any_list=searched)
        parameters, undetermined = intervals(problem, effects, comparison)
        found = Round(
            effects,
            comparison,
            *comparison.checks(problem),
            parameters,
            undetermined,
            store.once(f"{number}_localise", lambda: localising.phases(problem, effects, comparison)),
            again=again,
            beside=beside,
            incumbent=before[-1].comparison.known if beside else {},
        )
        residuals = [*(earlier.comparison.residual for earlier in before), comparison.residual]
        found.errors = comparison.excess(problem, residuals)
        found.spend("compare", self._effort([f"{number}_compare"], comparison.rollouts))
        return found

    def _examined(self, found: Round, before: Sequence[Round], progress: Progress, compete: bool = True) -> Round:
        """The rest of a round, as far as it is asked for: hypotheses screened, and those fitted that could win. Effects
        ``compete`` as long as there are not too many.
        """
        problem, store, options, effects = self.problem, self.store, self.options, found.effects
        if options.until in ("compare", "localise"):
            return found
        number = _number(len(before) + 1, found.again, before, found.beside)
        if compete and len(effects) - len(problem.physics.effects) < options.effects:
            found.candidates = candidates_for(problem, options, effects)
        told = prefixed(progress, "screen: ")
        look = partial(probe, problem, effects, found.comparison, found.candidates, told)
        found.probes = probes = store.once(f"{number}_probe", look)
        found.screening = judge(problem, found.comparison, probes)
        found.spend("screen", self._effort([f"{number}_probe"], probes.simulated))
        if options.until == "screen":
            return found
        self._fit_hypotheses([*before, found], progress)
        found.finished = True
        return found

    def _confirmed(self, found: Round, progress: Progress) -> bool:
        """Whether the effect that the last round has added is still needed in the model of the next one, whose errors
        were learnt again around it.
        """
        if not self.rounds:
            return True
        progress(f"is {name_of(found.effects[-1])} still needed?")
        name = f"{_number(len(self.rounds) + 1, found.again, self.rounds)}_needed"
        needed, simulated = self.store.once(name, partial(newest_is_needed, self.problem, self.rounds[-1], found))
        found.spend("confirm", self._effort([name], simulated))
        return needed

    def _fit_hypotheses(self, rounds: Sequence[Round], progress: Progress, kept: Sequence[Refit] = ()) -> None:
        """Fit in the last of some rounds every hypothesis that could win, but those of the refits that are kept, and
        take over the best of all, if one is believed.
        """
        found = rounds[-1]
        assert found.screening is not None
        number = _number(len(rounds), found.again, rounds, found.beside)
        competition = Competition(self.problem, self.store, number, found, progress, kept)
        found.refits = competition.run()
        tried = [name for name in self.store.seconds if name.startswith(f"{number}_refit_")]
        found.spend("refit", self._effort(tried, competition.simulated))
        found.accepted, found.indistinguishable = None, []
        contenders = [again.contender for again in found.refits]
        odds = log_odds(contenders, int(self.problem.usable.sum()), found.screening.usual_scale)
        leader = best(contenders, odds)
        if leader is not None:
            found.accepted = next(again for again in found.refits if again.name == leader.name)
            found.indistinguishable = indistinguishable(leader, odds)

    def _take_back(self, why: Round | SimulationError, progress: Progress) -> None:
        """Do without the refit that was taken over in the last round, as it is not needed in the model of the round
        after it, or as that model cannot be examined. The next best takes its place; what was given up as it fell
        behind has another chance.
        """
        last = self.rounds[-1]
        assert last.accepted is not None
        name = last.accepted.name
        if isinstance(why, SimulationError):
            last.left_out[name] = str(why)
        else:
            progress(f"{name} is not needed beside what a model with it may get wrong")
            last.unconfirmed.append(name)
            for step, effort in why.effort.items():
                last.spend(step, effort)
        self._fit_hypotheses(self.rounds, progress, [again for again in last.refits if again.name != name])

    def _widened(self) -> bool:
        """Where the rounds end with an unknown cause or with more than the model predicts: fit the hypotheses to which
        no straight line led, in the last round, then in those before it, until another effect wins in one of them. The
        rounds end with that one then. Returns whether there is one.
        """
        rounds = self.rounds
        if not (unknown_wins(rounds[-1]) or leaves_more(rounds[-1])):
            return False
        for count in range(len(rounds), 0, -1):
            found = rounds[count - 1]
            if found.widened or found.screening is None:
                continue
            found.widened, before = True, found.accepted
            self._fit_hypotheses(rounds[:count], prefixed(self.progress, f"round {count}, "), found.refits)
            if found.accepted is not None and (before is None or found.accepted.name != before.name):
                del rounds[count:]
                return True
        return False

    def _effort(self, steps: Sequence[str], simulated: float) -> dict[str, float]:
        """Seconds of some steps together, and the number of their simulations."""
        return {"seconds": round(sum(self.store.seconds[name] for name in steps), 1), "simulations": simulated}


def check(problem: Problem, options: Options) -> None:
    """Raise UserInputError for a mistake in the list of candidates, or when no model of the diagnosis can have the
    unknown that is to be profiled: before any long work.
    """
    candidates = candidates_for(problem, options, problem.physics.effects)
    known = problem.model(problem.physics.effects, problem.first_guess).names
    names = [*known, *(name for candidate in candidates for name in candidate.effect.parameters)]
    if options.profile is not None and options.profile not in names:
        raise UserInputError(
            f"diagnose: --profile {options.profile}: no such unknown; choose from {', '.join(known)}, or a coefficient "
            "of an effect that may be found"
        )


def candidates_for(problem: Problem, options: Options, installed: Sequence[Effect]) -> list[Candidate]:
    """What may be added to a model with these effects."""
    material = problem.physics.material
    if options.candidates is not None:
        found = read_candidates(Path(options.candidates), material, installed)
    else:
        found = whole_catalogue(material, problem.video.view_ids, installed)
    return [Candidate(candidate.name, problem.adopt(candidate.effect)) for candidate in found]


def _number(count: int, again: int, rounds: Sequence[Round], beside: str = "") -> str:
    """Of a round in the names of its steps: beginning again, in whose place effects compete, and what this round or one
    before it left out or fitted in addition, make others of it.
    """
    parts = [f"{count}_again{again}" if again else str(count), *([f"beside_{beside}"] if beside else [])]
    for place, found in enumerate(rounds, 1):
        parts += [f"widened_{place}"] if found.widened else []
        parts += [f"without_{name}" for name in (*found.left_out, *found.unconfirmed)]
    return "_".join(parts)


def better_model(problem: Problem, rounds: Sequence[Round]) -> tuple[int, dict[str, float]] | None:
    """The first round whose model is decisively better near an optimum that the last round found for its own, and the
    values there [SI]: every model of an earlier round is contained in that one. None where the last round found none.
    """
    known = rounds[-1].better
    if known is None:
        return None
    for place, earlier in enumerate(rounds[:-1]):
        comparison = earlier.comparison
        better = better_null(problem, earlier.effects, comparison, known, comparison.cost, comparison.fitted).known
        if better is not None:
            return place, better
    return len(rounds) - 1, known
