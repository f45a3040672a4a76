"""A model, a measurement and their error side by side, changed by hand or by a script and simulated at once."""

from pacnerf_lpo.explore.records import (
    Camera,
    Difference,
    EffectInfo,
    Errors,
    Measured,
    Motion,
    Outlines,
    Setting,
    Step,
    Suggestion,
)
from pacnerf_lpo.explore.session import Session

__all__ = [
    "Camera",
    "Difference",
    "EffectInfo",
    "Errors",
    "Measured",
    "Motion",
    "Outlines",
    "Session",
    "Setting",
    "Step",
    "Suggestion",
]
