"""Poses, rotations and intrinsics of other conventions, in those of this package. Pure NumPy.

OpenCV: x right, y down, looking along +z, the centre of the first pixel at 0. OpenGL and this package: x right, y up,
looking along -z. COLMAP, nerfstudio and this package put the centre of the first pixel at 0.5.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from pacnerf_lpo.errors import UserInputError

ROTATION_TOLERANCE = 1e-3
"""Rotations written with four digits still pass."""


def check_rotation(where: str, rotation: np.ndarray) -> None:
    """Raise UserInputError unless a matrix (3, 3) is a rotation: orthonormal, not scaled, sheared or mirrored."""
    error = np.abs(rotation.T @ rotation - np.eye(3)).max() if np.isfinite(rotation).all() else np.inf
    if error > ROTATION_TOLERANCE:
        raise UserInputError(
            f"{where}: its rotation is not orthonormal (off by {error:.2g}); write the 3 x 3 rotation without scale"
        )
    if np.linalg.det(rotation) < 0:
        raise UserInputError(f"{where}: its rotation is mirrored (determinant -1); an axis was flipped, flip it back")


def pose_from_opencv(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """OpenCV's world-to-camera rotation (3, 3) and translation (3,) as a camera-to-world pose, OpenGL axes (3, 4)."""
    return opengl_axes(np.column_stack((rotation.T, -rotation.T @ translation)))


def opengl_axes(pose: np.ndarray) -> np.ndarray:
    """A camera-to-world pose (3, 4) or (4, 4) with OpenCV's camera axes, as one with OpenGL's [(3, 4)]."""
    return np.asarray(pose, float)[:3] * [1.0, -1.0, -1.0, 1.0]


def pose_from_llff(columns: np.ndarray) -> np.ndarray:
    """LLFF's pose (3, 4), whose camera axes are down, right and backwards, with OpenGL's (3, 4)."""
    down, right, back, centre = np.asarray(columns, float).T
    return np.column_stack((right, -down, back, centre))


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' rotation vector [rad, (3,)] as a matrix (3, 3)."""
    return Rotation.from_rotvec(np.asarray(vector, float).reshape(3)).as_matrix()


def rotation_onto(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that takes the unit vector ``source`` to ``target`` [(3,) each].

    Between opposite vectors it is a half turn about an axis at a right angle to them.
    """
    return Rotation.align_vectors(target, source)[0].as_matrix()


def half_pixel_centres(intrinsic: np.ndarray) -> np.ndarray:
    """Intrinsics (3, 3) whose first pixel centre is at 0, for pixel centres at +0.5."""
    moved = np.array(intrinsic, float)
    moved[:2, 2] += 0.5
    return moved


def intrinsic_matrix(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """The matrix (3, 3) of focal lengths and principal point [pixels]."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def centred_intrinsic(field_of_view: float, width: int, height: int) -> np.ndarray:
    """Square pixels and a centred principal point, from the horizontal field of view [rad] (3, 3)."""
    focal = 0.5 * width / np.tan(0.5 * field_of_view)
    return intrinsic_matrix(focal, focal, width / 2, height / 2)
