"""By how much do other solvers differ from this one? From finished diagnoses of videos that they have made:

    python -m validation.solver_error runs/bird runs/torus runs/cat

Of each run the model that its diagnosis has ended with is taken. Writes ``results/solver_error.json`` and the page made
of it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.diagnosis.store import FOLDER, read
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.identification.forward_model import Model, with_effects
from pacnerf_lpo.identification.model_errors import CONTACT
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.mpm.effects import KelvinVoigt
from pacnerf_lpo.render.camera_faults import Observation
from validation.record import Record, keep, made, origin, table

SIZES = (0.0, 0.0025, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04)
TIMES = (2, 4)
WORDS = """
## In contact

A smooth force of which nothing is known acts in every model of a diagnosis, of 0.02 m/s^2, and from the first contact
on also of a share of the acceleration there. How much more probable is a recording with such a share than without?
Log marginal likelihood of all its data, material and motion integrated out, beside the effects that were found.
**Development figures**: `CONTACT`, 2 %, was the share that is best for all videos together while errors of the shape
were simulated on a coarse body alone; with those at two resolutions 1 % is. It stays until blind scenes are drawn anew.
"""
VISCOSITY = """
## In dissipation

The same model takes two and four times as many steps. What then changes looks, beside changes of material and motion,
like so much viscosity of the solid. Other codes take up to ten times as many steps, so every model of a solid may err
by `OWN_VISCOSITY`, 2.5 %: what four times as many added on average when it was chosen.
"""


def gains(problem: Problem, comparison: Comparison) -> list[float]:
    """Log marginal likelihood of all usable data with each of :data:`SIZES`, less that with none."""
    mask = problem.usable
    jacobian = np.nan_to_num(comparison.jacobian[mask])
    residual = comparison.residual[mask] + jacobian @ (comparison.free - comparison.mean)
    errors, found = comparison.errors, []
    for size in SIZES:
        noise = replace(errors, contact=size / CONTACT * errors.contact).noise(problem, mask)
        noise = noise.with_directions(jacobian * comparison.deviation)
        deviate = noise.whiten_residual(residual)
        volume = np.log1p(noise.weights**2).sum() - 2 * np.log(np.diagonal(noise.whitener, axis1=1, axis2=2)).sum()
        found.append(-0.5 * float(deviate @ deviate + volume))
    return [round(one - found[0], 2) for one in found]


def own_viscosity(problem: Problem, comparison: Comparison) -> dict[str, float]:
    """What rho h^2 / dt is [Pa s], and the viscosities that imitate :data:`TIMES` as many steps, in its units."""
    names, known = set(comparison.names), comparison.known
    kinds = [kind for kind in known_classes() if not issubclass(kind, Observation)]
    effects = [*problem.physics.effects, *(kind() for kind in kinds if set(kind.parameters) <= names)]  # type: ignore[call-arg]
    model, mask = problem.model(effects, known), problem.usable
    seen, physics = model.predict(model.start), model.physics
    noise = comparison.errors.but_of_solver.noise(problem, mask)
    unit = physics.rho * problem.spacing**2 * physics.substep_rate

    def change(other: Model) -> np.ndarray:
        return noise.whiten(np.nan_to_num(problem.relative(other.predict(other.start) - seen)[mask]))

    viscous = problem.model([*effects, KelvinVoigt()], {**known, "solid_viscosity": 0.01 * unit})  # type: ignore[call-arg]
    unknowns = noise.whiten(np.nan_to_num(comparison.jacobian[mask]) * comparison.deviation)
    columns = np.column_stack((unknowns, change(viscous) / 0.01))
    prior = np.eye(len(comparison.names), columns.shape[1])
    found = {"rho h^2 / dt": round(unit, 1)}
    for times in TIMES:
        model.physics = with_effects(physics, effects, 1 / times, 1.0)
        target = np.concatenate((change(model), np.zeros(len(prior))))
        found[f"steps x {times}"] = round(float(np.linalg.lstsq(np.vstack((columns, prior)), target)[0][-1]), 5)
    return found


def last_comparison(run: Path) -> Comparison:
    """Of the diagnosis of a run. Raises SystemExit where there is none."""
    found = sorted((run / FOLDER / "steps").glob("*_estimate.npz"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise SystemExit(f"{run}: no diagnosis; run `pacnerf-lpo diagnose {run}` first")
    return read(found[-1])["result"]


def page(record: Record) -> str:
    """The record as Markdown."""
    rows = [[run["run"], *run["gains"]] for run in record["runs"]]
    total = np.sum([run["gains"] for run in record["runs"]], axis=0).round(1)
    head = ["diagnosis", *(f"{100 * size:g} %" for size in record["sizes"])]
    shares = [[run["run"], *(run["viscosity"].values())] for run in record["runs"]]
    shown = [[name, unit, *(f"{100 * share:.1f} %" for share in more)] for name, unit, *more in shares]
    parts = [
        "# The error of the solver",
        origin(record, "solver_error", "`python -m validation.solver_error RUN ...`"),
        WORDS.strip(),
        table(head, [*rows, ["together", *total]]),
        VISCOSITY.strip(),
        table(["diagnosis", "rho h^2 / dt [Pa s]", *(f"{times} times as many" for times in TIMES)], shown),
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    record: Record = {**made(), "sizes": SIZES, "runs": []}
    for run in parser.parse_args().runs:
        problem, comparison = RunProblem(Run(run)), last_comparison(run)
        found = {"gains": gains(problem, comparison), "viscosity": own_viscosity(problem, comparison)}
        record["runs"].append({"run": run.name, **found})
        print(record["runs"][-1], flush=True)
    keep("solver_error", record, page)


if __name__ == "__main__":
    main()
