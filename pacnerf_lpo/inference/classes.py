"""Effects that one recording cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform


def correlation(signatures: np.ndarray) -> np.ndarray:
    """|cosine| between signatures, whitened and projected (K, K); 0 with a signature that vanishes.

    Args:
        signatures: one row for every effect (K, D)
    """
    sizes = np.linalg.norm(signatures, axis=1, keepdims=True)
    units = signatures / np.where(sizes > 0, sizes, 1.0)
    return np.minimum(np.abs(units @ units.T), 1.0)


def classes(signatures: np.ndarray, names: Sequence[str], threshold: float = 0.9) -> list[tuple[str, ...]]:
    """Merge effects whose signatures correlate above the threshold.

    Complete linkage: within a class *every* pair exceeds the threshold. "Cannot be told apart" is said of pairs;
    average or single linkage would chain the two ends of a row of neighbours, which can be told apart, into one class.

    Args:
        signatures: whitened and projected (K, D), in the order of ``names``, such as :attr:`Score.signature`
        names: of the effects (K,)
        threshold: of |correlation|

    Returns:
        The classes in the order of their first member; members in the order of ``names``.
    """
    if len(names) < 2:
        return [(name,) for name in names]
    distance = 1 - correlation(np.asarray(signatures))
    np.fill_diagonal(distance, 0.0)
    tree = linkage(squareform(distance, checks=False), method="complete")
    labels = fcluster(tree, 1 - threshold, criterion="distance")
    groups: dict[int, list[str]] = {}
    for label, name in zip(labels, names, strict=True):
        groups.setdefault(int(label), []).append(name)
    return [tuple(group) for group in groups.values()]
