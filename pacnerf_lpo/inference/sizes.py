"""How large errors are whose directions are known and whose common size is not: by the marginal likelihood of a
residual (type II maximum likelihood; Bishop 2006, section 3.5), in which all else that may be there competes with them.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from pacnerf_lpo.inference.noise import NoiseModel


def size_of_errors(
    noise: NoiseModel,
    residual: np.ndarray,
    errors: np.ndarray,
    sizes: Sequence[float],
    unknown: np.ndarray | None = None,
    spreads: Sequence[float] = (),
) -> float:
    """Root mean square of the size b over its posterior, where the residual is noise + b E e + s G g with normal e, g,
    b one of some sizes, and s either 0 or one of some spreads, all equally probable: what is missing in the model is
    not taken for an error of the shape as far as G can explain it.

    Args:
        noise: of the residual, with all else that may be wrong among its directions
        residual: at the mean of what moves with a prior (D,)
        errors: E, changes by each error of unit size (D, M)
        sizes: of them.
        unknown: G, changes by something that is missing in the model (D, Q); None: nothing is.
        spreads: of it.
    """
    unknown = errors[:, :0] if unknown is None else unknown
    columns = noise.whiten(np.concatenate((errors, unknown), axis=1))
    gram, along = columns.T @ columns, columns.T @ noise.whiten_residual(residual)
    found = np.empty((len(spreads) + 1, len(sizes)))
    for row, spread in enumerate((0.0, *spreads)):
        for column, size in enumerate(sizes):
            scales = np.repeat((size, spread), (errors.shape[1], unknown.shape[1]))
            lower = np.linalg.cholesky(np.eye(len(scales)) + scales[:, None] * gram * scales)
            explained = np.linalg.solve(lower, scales * along)
            found[row, column] = explained @ explained / 2 - np.log(np.diagonal(lower)).sum()
    weights = np.exp(logsumexp(found, axis=0) - logsumexp(found))
    return float(np.sqrt(weights @ np.square(sizes)))
