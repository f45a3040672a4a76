"""The fast path: a diagnosis of outlines alone, of a body whose shape is known but for a small distortion."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.identification.body import Body, Sampling
from pacnerf_lpo.identification.problem import BodyProblem, independent, noise_of_video
from pacnerf_lpo.identification.replicates import distorted
from pacnerf_lpo.identification.shape_modes import ShapeModes
from pacnerf_lpo.identification.silhouette_moments import silhouette_moments
from pacnerf_lpo.identification.split import HELD_FRAMES, Split
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import Video
from validation.hidden_effects.setting import FRAME_RATE, Setting

SETTING, VIDEO, TRUTH = "setting.json", "video.npz", "truth.json"


class KnownShape(BodyProblem):
    """Outlines of a body of known shape.

    Args:
        scene: its name.
        setting: what is known.
        video: with the silhouettes.
        measured: summaries and brightness [(V, F, 11)]
        noise: a root of the covariance of their noise in one view and frame [(V, F, 11, 11)]
    """

    def __init__(self, scene: str, setting: Setting, video: Video, measured: np.ndarray, noise: np.ndarray):
        self.setting = setting
        views, frames = measured.shape[:2]
        held = np.isin(np.arange(views), setting.held_views)
        split = Split(~held, np.arange(frames) < frames - HELD_FRAMES)
        super().__init__(scene, video, split, physics_of(setting), setting.spacing, measured, noise)

    @classmethod
    def read(cls, folder: Path) -> KnownShape:
        """A scene on disk; its truth stays sealed."""
        setting = Setting(**json.loads((folder / SETTING).read_text()))
        content = np.load(folder / VIDEO)
        silhouettes = torch.from_numpy(content["silhouettes"].astype(np.float32) / 255.0)
        return cls.seen(folder.name, setting, silhouettes, content["brightness"])

    @classmethod
    def seen(cls, scene: str, setting: Setting, silhouettes: Tensor, brightness: np.ndarray) -> KnownShape:
        """A scene as cameras see it: outlines [0..1, (V, F, H, W)] and logarithm of the mean brightness [(V, F)]."""
        measured = np.concatenate((silhouette_moments(silhouettes), brightness[..., None]), axis=-1)
        return cls(scene, setting, setting.video(silhouettes), measured, noise_of_video(silhouettes, brightness))

    @classmethod
    def simulated(cls, scene: str, setting: Setting, values: dict[str, float]) -> KnownShape:
        """What the model itself shows of a setting at some values [SI], without noise, even beyond the images."""
        video = setting.video()
        blank = np.ones((*video.silhouettes.shape[:2], 11))
        draft = cls(scene, setting, video, blank, independent(blank))
        model = draft.model((), {**draft.physics.guess, **values})
        path = model.path(model.start)
        measured = model.observe(path, model.start)
        return cls(scene, setting, video, measured, noise_of_video(model.outlines(path), measured[..., -1]))

    @property
    def spacing(self) -> float:
        return self.setting.spacing

    @property
    def least_shape_error(self) -> float:
        return self.setting.warp

    @cached_property
    def first_guess(self) -> dict[str, float]:
        return {**self.physics.guess, **self.setting.guess}

    def sample(self, spacing: float, seed: int) -> Body:
        """One particle in each cell of a lattice of spacing/2, at the centre of the matter there, distorted; every
        sampling alike.
        """
        return self._distorted(self._undistorted(spacing, seed))

    @cached_property
    def _reference(self) -> Body:
        return self._undistorted(self.setting.spacing, 0)

    def wrong_bodies(self, body: Body, sigma: float) -> list[Body]:
        """As those of a reconstruction: the distortion is not known to the model, only how large it is."""
        sampling = Sampling(self.setting.surface, body.spacing, 0)
        return ShapeModes(body, sigma).bodies(lambda depth: self._distorted(sampling.body(depth)))

    def _distorted(self, body: Body) -> Body:
        return distorted(body, self.setting.warp, np.random.default_rng(self.setting.warp_seed), self._reference)

    def _undistorted(self, spacing: float, seed: int) -> Body:
        return Sampling(self.setting.surface, spacing, seed).body()


def physics_of(setting: Setting) -> Physics:
    """The model that is questioned: the material on a sticky ground of unknown height, as configs/cpu.yaml has it."""
    return Physics(setting.law, substep_rate=setting.rate, frame_rate=FRAME_RATE, fit_ground_height=True)
