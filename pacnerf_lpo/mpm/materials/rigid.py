"""Bodies that do not deform."""

from types import SimpleNamespace

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.tensors import Tensor3


class Rigid(Material):
    """No parameters, and no stress: what moves is integrated by :mod:`pacnerf_lpo.mpm.rigid_body`, not on a grid."""

    parameters = {}  # noqa: RUF012
    deforms = False

    def __init__(self) -> None:
        super().__init__({})

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        raise UserInputError(
            "Rigid: a rigid body has no stress and cannot move on a grid; choose a material for videos"
        )
