"""Every suite as data: its scenes and its tables; the columns of the tables say which runs are needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from pacnerf_lpo.paper_tables.layouts import ErrorLayout, ImageLayout, Layout, SpreadLayout, TimeLayout, ValueLayout
from pacnerf_lpo.paper_tables.tables import Column

NINE = ("droplet", "letter", "cream", "toothpaste", "torus", "bird", "playdoh", "cat", "trophy")
SHARED = ("torus", "droplet", "playdoh", "cream", "trophy")
BASELINES = {"3v": "PAC-NeRF-3v", "3v_dagger": "PAC-NeRF-3v†", "6v": "PAC-NeRF-6v", "pac_nerf": "PAC-NeRF"}
CORRECTIONS = {"lpo": "+LPO", "lpo_f": "+LPO-F", "lpo_p": "+LPO-P", "go": "+GO"}
WITH_NONE = {**CORRECTIONS, "none": "+None"}
POWERS = "⁰¹²³⁴"
FULL = Column("PAC-NeRF", "pac_nerf")


@dataclass(frozen=True)
class Suite:
    """Tables over those of some scenes that the data folder has; with ``asset`` they are the package's own, and no data
    folder is needed. ``overlays`` are the suite's own files, relative to the folder of configurations.
    """

    scenes: tuple[str, ...]
    layouts: tuple[Layout, ...]
    overlays: tuple[str, ...] = ()
    asset: bool = False


def corrected(baseline: str, round_: int, corrections: dict[str, str] = CORRECTIONS) -> tuple[Column, ...]:
    """A baseline and what each correction makes of it, compared with each other."""
    power = POWERS[round_] if round_ > 1 else ""
    columns = (Column(f"{label}{power}", baseline, name, round_, baseline) for name, label in corrections.items())
    return (Column(BASELINES[baseline], baseline, group=baseline), *columns)


def by_round(baseline: str, rounds: Sequence[int]) -> tuple[Column, ...]:
    """A baseline and +LPO after each of these rounds."""
    columns = (Column(f"+LPO{POWERS[number]}", baseline, "lpo", number, baseline) for number in rounds)
    return (Column(BASELINES[baseline], baseline, group=baseline), *columns)


ABLATIONS = tuple(
    Column(label, baseline, round=0, group="static")
    for label, baseline in (
        ("(a) PAC-NeRF-3v", "3v"),
        ("(b) PAC-NeRF-3v†", "3v_dagger"),
        ("(c) w/o scheduling of L_surf", "3v_dagger_no_surface_schedule"),
        ("(d) w/o L_VI", "3v_dagger_no_view_invariant"),
        ("(e) w/o adjustment of TL", "3v_dagger_full_length"),
    )
)
ONCE = (*corrected("3v", 1), *corrected("3v_dagger", 1))
REPEATED = (*corrected("3v", 4, WITH_NONE), *corrected("3v_dagger", 4, WITH_NONE))
DAGGER_ROUNDS, DAGGER_LATER = by_round("3v_dagger", (1, 2, 3, 4)), by_round("3v_dagger", (2, 3, 4))
ROUNDS = (*by_round("3v", (1, 2, 3, 4)), *DAGGER_ROUNDS)
LATER_ROUNDS = (*by_round("3v", (2, 3, 4)), *DAGGER_LATER)

PAPER = (
    ImageLayout("table4", "Static voxel grid optimization, first frames, test views", ABLATIONS, first_frame=True),
    ImageLayout("table5", "Geometric correction, test views", (FULL, *ONCE)),
    ValueLayout("table6", "Physical identification from PAC-NeRF-3v", (FULL, *corrected("3v", 4, WITH_NONE))),
    ValueLayout("table7", "Physical identification from PAC-NeRF-3v†", (FULL, *corrected("3v_dagger", 4, WITH_NONE))),
    ImageLayout("table8", "Geometric recorrection, test views", (FULL, *REPEATED)),
    ImageLayout("table10", "Geometric (re)correction by number of rounds, test views", ROUNDS),
    ImageLayout("table11", "Geometric (re)correction by number of rounds, training views", ROUNDS, views="train"),
    ErrorLayout("table12", "Physical identification by number of rounds, error", LATER_ROUNDS),
    SpreadLayout(
        "table13",
        "Five view sets, test views, mean and standard deviation",
        (*corrected("3v_dagger", 1), *corrected("3v_dagger", 4, WITH_NONE)[1:]),
        view_sets=("", "3v_2", "3v_3", "3v_4", "3v_5"),
    ),
    ImageLayout("table14", "Geometric correction, six views", (FULL, *corrected("6v", 1))),
    ErrorLayout("table15", "Physical identification, six views, error", (FULL, *corrected("6v", 4, WITH_NONE))),
    ImageLayout("table16", "Geometric recorrection, six views", (FULL, *corrected("6v", 4, WITH_NONE))),
)
TABLE_9 = TimeLayout(
    "table9", "Computation times of one round of Algorithm 1", (Column("PAC-NeRF-3v+LPO", "3v", "lpo"),)
)
QUICK = (Column("PAC-NeRF-6v", "6v", group="6v"), Column("+LPO", "6v", "lpo", group="6v"))

SHARED_PARTS: dict[str, tuple[Layout, ...]] = {
    "shared_once": (
        ImageLayout(
            "correction_3v_dagger", "Geometric correction (R = 1), test views", corrected("3v_dagger", 1, WITH_NONE)
        ),
        ErrorLayout("identification_once", "Physical identification (R = 1), error", corrected("3v_dagger", 1, {})),
        TimeLayout("times_once", "Computation times of one round", (Column("PAC-NeRF-3v†+LPO", "3v_dagger", "lpo"),)),
    ),
    "shared_once_3v": (
        ImageLayout("correction_3v", "Geometric correction (R = 1), test views", corrected("3v", 1, WITH_NONE)),
        ErrorLayout("identification_once_3v", "Physical identification (R = 1), error", corrected("3v", 1, {})),
    ),
    "shared_rounds": (
        ImageLayout("rounds", "Geometric (re)correction by number of rounds, test views", DAGGER_ROUNDS),
        ErrorLayout("identification_rounds", "Physical identification by number of rounds, error", DAGGER_LATER),
    ),
    "shared_full_view": (
        ValueLayout("full_view", "Identification from all views", (FULL,)),
        ErrorLayout("full_view_error", "Identification from all views, error", (FULL,)),
    ),
}
"""Of the suite of the development videos: each costs less than the whole, which takes over what they have computed."""
SHARED_REPEATED = (
    ImageLayout("recorrection", "Geometric recorrection (R = 4), test views", REPEATED),
    ErrorLayout("identification", "Physical identification (R = 4), error", REPEATED),
)

SUITES = {
    **{layout.name: Suite(NINE, (layout,)) for layout in PAPER},
    "table9": Suite(("droplet",), (TABLE_9,)),
    **{name: Suite(SHARED, layouts) for name, layouts in SHARED_PARTS.items()},
    "shared": Suite(SHARED, (*chain.from_iterable(SHARED_PARTS.values()), *SHARED_REPEATED)),
    "quick": Suite(
        ("bird",),
        (
            ImageLayout("quick_images", "Geometric correction, test views", QUICK),
            ErrorLayout("quick_errors", "Physical identification, error", QUICK[:1]),
            TimeLayout("quick_times", "Computation times", QUICK[1:]),
        ),
        overlays=("demo.yaml", "benchmark/quick.yaml"),
        asset=True,
    ),
}
