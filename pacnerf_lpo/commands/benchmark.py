"""``pacnerf-lpo benchmark``: the paper's tables."""

from pathlib import Path

from pacnerf_lpo.errors import Interrupted, RunError, UserInputError
from pacnerf_lpo.named_configs import configs_folder, find_config
from pacnerf_lpo.paper_tables.plan import PlannedRun, plan_runs
from pacnerf_lpo.paper_tables.runner import Backend, Resources, run_all
from pacnerf_lpo.paper_tables.scenes import asset_scene, find_scenes
from pacnerf_lpo.paper_tables.scores import Book
from pacnerf_lpo.paper_tables.suites import SUITES
from pacnerf_lpo.paper_tables.tables import markdown, write_table


def run(
    suite: str = "quick",
    output: str = "runs/benchmark",
    data_root: str | None = None,
    scenes: list[str] | None = None,
    overlay: list[str] | None = None,
    configs: str | None = None,
    jobs: int = 1,
    backend: Backend = "loky",
    memory: float | None = None,
    dry_run: bool = False,
) -> None:
    """Run what a suite's tables need and is not there yet, and write the tables as Markdown, CSV and LaTeX.

    A suite is one of the paper's tables, table4 to table16; quick, two small runs on the shipped scene; or shared, five
    development videos, with its parts shared_once and shared_once_3v (R = 1), shared_rounds (3v† + LPO, R = 1 to 4)
    and shared_full_view. Stop it with Ctrl-C; the same command goes on.

    example: pacnerf-lpo benchmark --suite quick --output runs/quick

    example: pacnerf-lpo benchmark --suite table5 --data-root data --overlay cpu --output runs/table5

    Args:
        suite: name of the suite.
        output: folder of the benchmark: runs/ with one folder per run, tables/ with the tables.
        data_root: folder with one folder per scene; quick needs none.
        scenes: only these of the suite's scenes.
        overlay: configurations put on top of scene and baseline of every run: files, or names such as cpu.
        configs: folder of configurations to take instead of those of the package.
        jobs: how many runs at the same time; each gets its share of the CPU cores.
        backend: what runs them when jobs is more than 1; dask and ray need their package.
        memory: limit of each run's memory [GiB]; none when not given.
        dry_run: list the runs and what is missing, and run nothing.
    """
    if suite not in SUITES:
        raise UserInputError(f"there is no suite {suite}; known are {', '.join(SUITES)}")
    chosen, folder = SUITES[suite], Path(output)
    settings = configs_folder() if configs is None else Path(configs)
    names = chosen.scenes if scenes is None else tuple(name for name in chosen.scenes if name in scenes)
    for name in set(scenes or ()) - set(names):
        raise UserInputError(f"--scenes {name}: no scene of the suite {suite}; it has {', '.join(chosen.scenes)}")
    resources = Resources(jobs, backend, None if memory is None else round(memory * 2**30))
    if chosen.asset:
        places = [asset_scene(name) for name in names]
    elif data_root is None:
        raise UserInputError(f"the suite {suite} wants --data-root, a folder with one folder per scene")
    else:
        places = find_scenes(Path(data_root), names, settings, folder / "truth")
    runs = plan_runs(chosen, places, settings, [find_config(name, "--overlay") for name in overlay or []], folder)
    if dry_run:
        print("\n".join(_line(one) for one in runs))
        return
    outcomes = run_all(runs, folder, resources)
    book = Book(runs, outcomes)
    for layout in chosen.layouts:
        table = layout.build(book, places)
        write_table(table, folder / "tables")
        print(markdown(table))
    print(f"tables: {folder / 'tables'}")
    ended = [outcomes[one.run_dir].status if one.run_dir in outcomes else "stopped" for one in runs]
    if "stopped" in ended:
        raise Interrupted(
            f"stopped; {ended.count('finished')} of {len(runs)} runs are finished; the same command goes on"
        )
    if "failed" in ended:
        raise RunError(
            f"{ended.count('failed')} of {len(runs)} runs failed, the tables say why; the same command tries again"
        )


def _line(run: PlannedRun) -> str:
    state = "finished" if run.is_finished() else "started" if run.run_dir.exists() else "missing"
    start = "" if run.start is None else f", starts from {run.start.name}"
    return f"{state:<9} {run.name}, R = {run.rounds}, key {run.key}{start}"
