"""Effects that one recording cannot separate."""

import numpy as np


def correlation(signatures: np.ndarray) -> np.ndarray:
    """|cosine| between signatures, whitened and projected, of K effects (K, D): (K, K); 0 where one vanishes."""
    sizes = np.linalg.norm(signatures, axis=1, keepdims=True)
    units = signatures / np.where(sizes > 0, sizes, 1.0)
    return np.minimum(np.abs(units @ units.T), 1.0)
