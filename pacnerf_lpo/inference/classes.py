"""Effects that one recording cannot separate."""

import numpy as np


def correlation(signatures: np.ndarray) -> np.ndarray:
    """|cosine| between signatures, whitened and projected (K, K); 0 with a signature that vanishes.

    Args:
        signatures: one row for every effect (K, D)
    """
    sizes = np.linalg.norm(signatures, axis=1, keepdims=True)
    units = signatures / np.where(sizes > 0, sizes, 1.0)
    return np.minimum(np.abs(units @ units.T), 1.0)
