"""What a session hands out: plain records with numbers, units and words, for a page, a notebook or a script."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

Resolution = Literal["coarse", "refined"]
Kind = Literal["open", "set", "add", "remove", "fit", "diagnose"]


@dataclass(frozen=True)
class Setting:
    """One number of the model that can be changed.

    name: as :meth:`Session.set` takes it, such as ``E``, ``v_x``, ``drag`` or ``v_x@low`` in a study.
    label: how a person calls it.
    unit: SI unit, ``"1"`` where it has none, ``"deg"`` for angles.
    group: ``material``, ``motion``, ``ground``, or the name of the effect that it belongs to, such as ``LinearDrag``
        or ``CameraShift@3``.
    value: in the current step.
    null: where its effect vanishes; None of a number that belongs to no effect.
    low, high: between them it may be set.
    slider: range in which a hand looks for it, within ``low`` and ``high``.
    logarithmic: whether it spans decades.
    interval: 90 % interval of the last fit that identified it; None where there was none.
    active: whether the model has it: False of an effect that was not added.
    fitted: whether :meth:`Session.fit` can identify it.
    recording: the one that it belongs to; None: it belongs to the object.
    """

    name: str
    label: str
    unit: str
    group: str
    value: float
    null: float | None
    low: float
    high: float
    slider: tuple[float, float]
    logarithmic: bool
    interval: tuple[float, float] | None
    active: bool
    fitted: bool
    recording: str | None


@dataclass(frozen=True)
class EffectInfo:
    """An effect that the model has or could have.

    name: such as ``LinearDrag`` or ``CameraShift@3``.
    readable: such as *linear drag*.
    settings: names of its coefficients.
    signature: what a video shows of it.
    confused_with: names of effects with nearly the same signature.
    active: whether the model has it.
    camera: file id of the camera that it concerns; None: it is physics, or concerns all cameras.
    """

    name: str
    readable: str
    settings: tuple[str, ...]
    signature: str
    confused_with: tuple[str, ...]
    active: bool
    camera: int | None


@dataclass(frozen=True)
class Step:
    """One state of the model in the history.

    number: of the step, from 0; it never changes.
    parent: the step it was made from; None of the first.
    name: what was changed, such as ``drag 1.5 1/s``.
    kind: what made it.
    values: of all numbers of the model [SI]
    effects: names of those that the model has.
    intervals: 90 % intervals by name [SI], of the last fit that identified each.
    resolution: of the body that it was simulated on.
    fitted, held_out: root mean square error of the fitted and of the held-out data [unit of the session]; None where
        the motion is unstable, or nothing is held out.
    trouble: why it could not be simulated; None: it could.
    notes: sentences about what is doubtful.
    """

    number: int
    parent: int | None
    name: str
    kind: Kind
    values: dict[str, float]
    effects: tuple[str, ...]
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    resolution: Resolution = "coarse"
    fitted: float | None = None
    held_out: float | None = None
    trouble: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Errors:
    """Where a step's model differs from the measurement, relative to frame 0 of each view.

    unit: ``px`` or ``mm``, of all errors.
    rows: names of the R rows: cameras, then tracked points and clouds.
    cameras: file ids of the rows that are cameras [V]; the other rows follow.
    recordings: name of the recording of every row [R]
    times: of the frames [s, (F,)]
    table: root mean square over the silhouette moments or coordinates of every row and frame [(R, F)]; NaN where
        nothing was measured or the model is out of sight.
    held: which of them are held out [(R, F), bool]
    fitted, held_out: root mean square of the two parts; None where there is none.
    by_frame_fitted, by_frame_held_out: the same of every frame [(F,)]; NaN where there is none.
    floor: root mean square of the model's numerical error and of the sensor noise in the two parts, where a diagnosis
        or :meth:`Session.prepare` has learnt them; else None.
    resolution: of the body.
    """

    unit: str
    rows: tuple[str, ...]
    cameras: tuple[int, ...]
    recordings: tuple[str, ...]
    times: np.ndarray
    table: np.ndarray
    held: np.ndarray
    fitted: float | None
    held_out: float | None
    by_frame_fitted: np.ndarray
    by_frame_held_out: np.ndarray
    floor: tuple[float, float] | None
    resolution: Resolution

    def of(self, recording: str) -> "Errors":
        """The rows of a recording, its cameras first."""
        own = np.array([name == recording for name in self.recordings], bool)
        rows = tuple(row.removesuffix(f" of {recording}") for row, mine in zip(self.rows, own, strict=True) if mine)
        return replace(self, table=self.table[own], held=self.held[own], rows=rows)


@dataclass(frozen=True)
class Motion:
    """The simulated body of one recording.

    times: of the frames [s, (F,)]
    positions: of the particles [m, (F, N, 3), float32]
    speed: [m/s, (F, N), float32]
    colours: appearance of every particle [0..1, (N, 3)]; grey where no video shows it.
    size: distance between neighbouring particles at frame 0 [m]
    resolution: of the body.
    """

    times: np.ndarray
    positions: np.ndarray
    speed: np.ndarray
    colours: np.ndarray
    size: float
    resolution: Resolution


@dataclass(frozen=True)
class Outlines:
    """One camera at one frame.

    image: measured [0..1, (H, W, 3)]
    measured: opacity in the measured matte [0..1, (H, W)]
    model: opacity of the model [0..1, (H, W)]
    """

    image: np.ndarray
    measured: np.ndarray
    model: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Measured minus model [-1..1, (H, W)]: positive where only the video shows the body."""
        return self.measured - self.model


@dataclass(frozen=True)
class Camera:
    """A camera of a recording.

    view: file id, as the methods of a session take it.
    name: how a person calls it.
    recording: that it belongs to.
    held_out: whether no frame of it is fitted.
    camera_to_world: [rotation and metres, (3, 4)], OpenGL axes.
    intrinsics: [pixels, (3, 3)]
    width, height: of its images [pixels]
    """

    view: int
    name: str
    recording: str
    held_out: bool
    camera_to_world: np.ndarray
    intrinsics: np.ndarray
    width: int
    height: int


@dataclass(frozen=True)
class Measured:
    """What was measured in space at one frame of a recording.

    hull: points of the visual hull of all mattes [m, (M, 3)]; empty where no camera looked.
    cell: distance between neighbouring points of it [m]
    tracks: points that were followed [m, (P, 3)]
    cloud: points of a cloud taken at that frame [m, (C, 3)]
    centre: of a rigid body [m, (3,)]; None where it was not measured so.
    """

    hull: np.ndarray
    cell: float
    tracks: np.ndarray
    cloud: np.ndarray
    centre: np.ndarray | None


@dataclass(frozen=True)
class Suggestion:
    """An effect that may help.

    effect: its name, as :meth:`Session.add` takes it.
    readable: how a person calls it.
    log_bayes_factor: logarithm of how many times more probable the recording is with it than without; a lower bound of
        it where another effect is ahead by so much that the fit was given up.
    p_value: probability that the best of all effects scores as high where nothing is missing.
    stands_out: whether that is below the level at which a diagnosis adds an effect.
    fitted: whether the two come from a fit of all parameters with it; else from the linear change that one simulation
        of it shows.
    values: of its coefficients that explain most [SI]
    intervals: 90 % intervals of them [SI]
    units: of them.
    signature: what a video shows of it.
    confused_with: names of other effects with nearly the same signature.
    separating_experiment: which recording would separate them.
    """

    effect: str
    readable: str
    log_bayes_factor: float
    p_value: float
    stands_out: bool
    fitted: bool
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    units: dict[str, str]
    signature: str
    confused_with: tuple[str, ...]
    separating_experiment: str


@dataclass(frozen=True)
class Difference:
    """Two steps compared.

    before, after: their numbers.
    changed: settings that differ, with both values [SI]; None where a model has it not.
    fitted, held_out: errors of the two [unit of the session]; None where there is none.
    unit: ``px`` or ``mm``.
    change: of the error of every row and frame, after minus before [(R, F)]; NaN where one is missing.
    """

    before: int
    after: int
    changed: dict[str, tuple[float | None, float | None]]
    fitted: tuple[float | None, float | None]
    held_out: tuple[float | None, float | None]
    unit: str
    change: np.ndarray
