"""Many points that follow few particles: a body is drawn more smoothly than it was simulated."""

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 12
FINER = 2
"""Points are drawn so much closer together than particles are simulated."""
OUTLINE, COVER = 0.4, 1.0
"""Radii of discs in distances between the points. The union of the first ones is as large as the body, its area within
1.5 %, 3 % for a tube four particles thick; that of the others, which hide what is inside, is too large by 0.5 to 0.7
distances."""
TINY = 1e-6


def carried(points: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Where particles on a path [m, (F, N, 3)] carry points of the body [m, (P, 3)]: by the affine motion of each one's
    neighbours at frame 0, the nearer the more (moving least squares, Lancaster and Salkauskas 1981) [m, (F, P, 3)].
    """
    distances, near = cKDTree(path[0]).query(points, k=min(NEIGHBOURS, path.shape[1]))
    weights = np.exp(-((distances / distances.mean(1, keepdims=True).clip(TINY)) ** 2))
    reach = distances.max(1).clip(TINY)[:, None, None]
    basis = np.concatenate((np.ones((*near.shape, 1)), (path[0][near] - points[:, None]) / reach), axis=-1)
    moments = np.einsum("pk,pki,pkj->pij", weights, basis, basis) + TINY * np.eye(4)
    shares = weights * np.einsum("pi,pki->pk", np.linalg.inv(moments)[:, 0], basis)
    shares /= shares.sum(1, keepdims=True)
    return np.stack([np.einsum("pk,pkj->pj", shares, frame[near]) for frame in path])
