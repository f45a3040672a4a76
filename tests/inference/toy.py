"""A linear world with the structure of a real comparison: a falling body seen by several cameras.

Errors of the model are smooth in time and common to all views (they are errors of the motion in space) plus a smaller
part of each view's own (errors of the shape); the sensor's are white. Everything is seeded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.inference.calibration import Fitted
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.layout import Layout
from pacnerf_lpo.inference.noise import NoiseModel

VIEWS, FRAMES = 4, 12
KINDS = ("x", "y", "size", "height")
TIME = np.arange(FRAMES) / (FRAMES - 1)
CONTACT = np.clip((TIME - 0.6) / 0.4, 0.0, None)
SENSOR = 0.1


def layout() -> Layout:
    view, frame, kind = np.meshgrid(np.arange(VIEWS), np.arange(FRAMES), np.array(KINDS), indexing="ij")
    return Layout(view.ravel(), frame.ravel(), kind.ravel())


def entries(whole: Layout, mask: np.ndarray) -> Layout:
    """The entries of a layout for which ``mask`` is true, or those with these numbers."""
    return Layout(whole.view[mask], whole.frame[mask], whole.kind[mask])


def seen(along_x=0.0, along_y=0.0, along_z=0.0, taller=0.0) -> np.ndarray:
    """Residual [px, (D,)] of a motion along the axes of space and a stretch, each a function of time (F,)."""
    angles = 0.3 + 2 * np.pi * np.arange(VIEWS) / VIEWS
    change = np.zeros((VIEWS, FRAMES, len(KINDS)))
    for view, angle in enumerate(angles):
        change[view, :, 0] = np.cos(angle) * along_x + np.sin(angle) * along_z
        change[view, :, 1] = along_y
        change[view, :, 2] = (
            0.05 * (np.cos(angle) * np.asarray(along_z) - np.sin(angle) * np.asarray(along_x)) + 0.1 * taller
        )
        change[view, :, 3] = taller
    return change.ravel()


def one_view(view: int, kind: str, course: np.ndarray) -> np.ndarray:
    """Residual [px, (D,)] that one camera alone shows."""
    change = np.zeros((VIEWS, FRAMES, len(KINDS)))
    change[view, :, KINDS.index(kind)] = course
    return change.ravel()


def jacobian() -> np.ndarray:
    """Start velocity along three axes, stiffness and Poisson's ratio (D, 5)."""
    bounce = CONTACT**2
    return np.stack(
        (
            seen(along_x=TIME), seen(along_y=TIME), seen(along_z=TIME),
            seen(along_y=bounce, taller=np.sin(8 * CONTACT)), seen(along_y=0.3 * bounce, taller=CONTACT),
        ), axis=1
    )  # fmt: skip


EFFECTS: dict[str, tuple[list[np.ndarray], bool, bool]] = {
    "linear drag": ([seen(along_y=TIME**3 + 0.02 * TIME**4)], True, False),
    "quadratic drag": ([seen(along_y=TIME**3 + 0.15 * TIME**4)], True, False),
    "gravity": ([seen(along_y=TIME**2)], False, False),
    "uniform force": ([seen(along_x=TIME**2), seen(along_z=TIME**2)], False, True),
    "viscosity": ([seen(along_y=-CONTACT, taller=0.6 * CONTACT**2 - np.sin(12 * CONTACT))], True, False),
    "slip": (
        [seen(along_x=CONTACT, taller=-0.2 * CONTACT), seen(along_x=CONTACT**2, along_z=0.3 * CONTACT**2)], True, False,
    ),
    "yield stress": ([seen(taller=-(CONTACT**3)), seen(taller=-np.sqrt(CONTACT))], True, False),
    "spin": ([seen(taller=np.sin(5 * TIME))], False, False),
    "time offset": ([seen(along_x=0.3 + 0 * TIME, along_y=1 + 2 * TIME)], False, False),
    "camera shift 0": ([one_view(0, "x", np.ones(FRAMES))], False, False),
    "camera shift 2": ([one_view(2, "x", np.ones(FRAMES))], False, False),
    "camera drift 1": ([one_view(1, "y", TIME)], False, False),
    "zoom 3": ([one_view(3, "size", np.ones(FRAMES)) + one_view(3, "height", np.ones(FRAMES))], False, False),
}  # fmt: skip


def hypotheses(width: float = 5.0) -> list[Hypothesis]:
    """Every effect, with a prior standard deviation of its coefficients that is the same for all."""
    return [
        Hypothesis.of_probes(
            name,
            np.stack(columns, axis=1),
            np.ones(len(columns)),
            np.full(len(columns), width),
            one_sided,
            len(columns) if joint else 1,
        )
        for name, (columns, one_sided, joint) in EFFECTS.items()
    ]


@dataclass(frozen=True)
class World:
    """How wrong the model is, numerically: amplitudes of errors of the motion and of each view's own [px]."""

    common: float = 0.4
    own: float = 0.15

    def bias(self) -> np.ndarray:
        return seen(along_y=0.5 * TIME**2, taller=0.3 * CONTACT)

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Residuals under the null model (count, D)."""
        own = smooth(rng, (count, VIEWS, len(KINDS))).transpose(0, 1, 3, 2).reshape(count, -1)
        motions = smooth(rng, (count, 4)) * TIME**1.5
        common = np.array([seen(*motion) for motion in motions])
        noise = SENSOR * rng.standard_normal(own.shape)
        return self.bias() + self.common * common + self.own * own + noise


PRIOR = 5.0
"""Standard deviation of the parameters' priors."""


def learnt(rng: np.random.Generator, count: int, world: World | None = None) -> NoiseModel:
    """The noise model of a comparison: from replicates, with the fitted parameters among its directions."""
    return of_rows((world or World()).draw(rng, count), np.ones(len(layout()), bool))


def of_rows(drawn: np.ndarray, rows: np.ndarray) -> NoiseModel:
    """The noise model of some of the data [(D,), bool], from replicates (T, D)."""
    sensor = np.full(int(rows.sum()), SENSOR)
    return NoiseModel.from_replicates(drawn[:, rows], sensor, entries(layout(), rows), PRIOR * jacobian()[rows])


def all_fitted(noise: NoiseModel, count: int) -> list[Fitted]:
    """For so many hypotheses: nothing is held out."""
    return [Fitted(np.ones(len(noise.mean), bool), noise)] * count


def smooth(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Random functions of time with unit variance and a correlation of exp(-(t - t')^2 / 2 0.3^2) (..., F)."""
    covariance = np.exp(-((TIME[:, None] - TIME) ** 2) / 2 / 0.3**2) + 1e-9 * np.eye(FRAMES)
    return rng.standard_normal((*shape, FRAMES)) @ np.linalg.cholesky(covariance).T
