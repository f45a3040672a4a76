"""What a table compares: cells, each one scene under one baseline, correction and round."""

from dataclasses import dataclass

NO_CORRECTION = "none"


@dataclass(frozen=True)
class Column:
    """One column of a table.

    label: its heading, such as ``+LPO⁴``.
    baseline, correction: names of files in ``configs/baselines`` and ``configs/corrections``.
    round: after which round of Algorithm 1; 0 is the static phase.
    group: columns of one group are compared with each other; an empty group is a reference.
    """

    label: str
    baseline: str
    correction: str = NO_CORRECTION
    round: int = 1
    group: str = ""

    @property
    def phase(self) -> str:
        """The phase whose images the column shows."""
        if self.round == 0:
            return "static"
        return "physics" if self.correction == NO_CORRECTION else "correction"


@dataclass(frozen=True, order=True)
class RunName:
    """Which run of a suite: the results after every round come out of one run, so the round is not part of it.

    scene: name of the scene.
    baseline: name of a file in ``configs/baselines``.
    correction: name of a file in ``configs/corrections``; empty for the common beginning of all corrections: static
        grids, velocity and the first identification, which is also the baseline's own result.
    views: name of a file in ``configs/views``; empty for the baseline's own views.
    """

    scene: str
    baseline: str
    correction: str = ""
    views: str = ""

    @property
    def beginning(self) -> "RunName":
        """The run it starts from; itself when it is a beginning."""
        return RunName(self.scene, self.baseline, "", self.views)

    def __str__(self) -> str:
        parts = (self.scene, self.baseline, self.views, self.correction or "baseline")
        return " ".join(part for part in parts if part)


def run_of(scene: str, column: Column, views: str = "") -> RunName:
    """The run in which a column's figures for a scene are found; +None of the first round is the baseline itself."""
    begins = column.correction == NO_CORRECTION and column.round <= 1
    return RunName(scene, column.baseline, "" if begins else column.correction, views)
