"""Doubts where identification by images and identification by outlines give different answers."""

from collections.abc import Iterator, Mapping
from typing import Any

from pacnerf_lpo.evaluation.doubts.doubt import Doubt
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT, Physics

DIFFERENT = 2.0
"""Noticeable changes (``Parameter.scale``) between the two answers, one for each of them."""


def doubts_about_methods(methods: Mapping[str, Any] | None, physics: Physics) -> Iterator[Doubt]:
    """The answers of two methods differ by more than a noticeable change of each.

    Args:
        methods: what was found on a coarse body; None: they were not compared.
        physics: the model.
    """
    if methods is None:
        return
    for name, by_images in methods.get("images", {}).items():
        parameter, by_outlines = physics.parameters[name], methods["outlines"][name]
        apart = abs(parameter.transform.to_free(by_images) - parameter.transform.to_free(by_outlines))
        if name != GROUND_HEIGHT.name and apart > DIFFERENT * parameter.scale:
            excess = methods["excess"]
            yield Doubt(
                "methods_differ",
                f"physics, {name}",
                f"on a coarse body of {methods['particles']} particles, images give {parameter.show(by_images)} and "
                f"outlines {parameter.show(by_outlines)}; each costs {excess['images']:.3g} % and "
                f"{excess['outlines']:.3g} % more at the answer of the other",
                "shading that changes along the fall pulls colours, or the outlines are wrong or show too little",
                "believe outlines where the light comes from one side and mattes are good (--config cpu_outlines), "
                "images where mattes are poor or the body has a strong texture",
            )
