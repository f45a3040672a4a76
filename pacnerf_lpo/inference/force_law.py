"""Which term would a residual acceleration be: sparse regression on a library of candidate laws."""

from dataclasses import dataclass

import numpy as np

LEAST_SHARE = 0.02
"""A term stays while dropping it would cost at least this share of the mean square acceleration."""
STABLE = 0.8
"""Terms found in at least this share of the resamples are named."""
RESAMPLES = 100


@dataclass(frozen=True)
class Term:
    """One term of the law: a = coefficient * term.

    name: of the term, such as ``-v``
    coefficient: [unit]
    unit: of the coefficient
    low, high: 5 % and 95 % quantiles over the resamples in which it was found
    frequency: share of the resamples in which it was found
    share: of the mean square acceleration that would be lost without it
    """

    name: str
    coefficient: float
    unit: str
    low: float
    high: float
    frequency: float
    share: float


@dataclass(frozen=True)
class Law:
    """What the regression found.

    terms: the stable ones, largest share first; none if nothing in the library fits
    explained: share of the mean square acceleration that they explain [0..1]
    """

    terms: list[Term]
    explained: float


def library(
    velocity: np.ndarray, position: np.ndarray, spin: np.ndarray, contact: np.ndarray
) -> dict[str, tuple[str, np.ndarray]]:
    """Candidate terms: unit of the coefficient, and values (n, 3).

    Args:
        velocity: [m/s, (n, 3)]
        position: [m, (n, 3)]
        spin: angular velocity of the body [rad/s, (n, 3)]
        contact: whether the body touches the ground [(n,), bool]
    """
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    touching = np.asarray(contact, float)[:, None]
    level = velocity * np.array([1.0, 0.0, 1.0])
    ones = np.broadcast_to(np.eye(3)[:, None], (3, *velocity.shape))
    axes = {f"1 along {name}": ("m/s^2", one) for name, one in zip("xyz", ones, strict=True)}
    return axes | {
        "-v": ("1/s", -velocity),
        "-|v| v": ("1/m", -speed * velocity),
        "-x": ("1/s^2", -position),
        "spin x v": ("1", np.cross(spin, velocity)),
        "-v along the ground, in contact": ("1/s", -touching * level),
        "1 along y, in contact": ("m/s^2", touching * np.array([0.0, 1.0, 0.0])),
    }


def name_force(
    acceleration: np.ndarray,
    velocity: np.ndarray,
    position: np.ndarray,
    spin: np.ndarray,
    contact: np.ndarray,
    blocks: np.ndarray,
    seed: int = 0,
) -> Law:
    """Sparse regression with stability selection (Brunton et al. 2016; Meinshausen and Buehlmann 2010).

    Terms are dropped one by one, each time the one whose loss costs least, while that is less than 2 % of the mean
    square. So of two that resemble each other, the better stays. The same on resampled blocks says how often a term is
    found.

    Args:
        acceleration: residual, model to measurement [m/s^2, (n, 3)]
        velocity, position, spin, contact: as of :func:`library`
        blocks: samples of one block are resampled together, such as those of one frame: errors are correlated (n,)
        seed: of the resampling
    """
    terms = library(velocity, position, spin, contact)
    names = list(terms)
    values = np.stack([term for _, term in terms.values()])
    labels = np.unique(blocks, return_inverse=True)[1]
    grams = np.array([_gram(values[:, labels == b], acceleration[labels == b]) for b in range(labels.max() + 1)])
    chosen, coefficients, shares = _sparse(grams.sum(0))
    rng = np.random.default_rng(seed)
    found = np.full((RESAMPLES, len(names)), np.nan)
    for row in found:
        picked, values_found, _ = _sparse(grams[rng.integers(0, len(grams), len(grams))].sum(0))
        row[picked] = values_found
    result = []
    for index, coefficient, share in zip(chosen, coefficients, shares, strict=True):
        draws = found[np.isfinite(found[:, index]), index]
        frequency = len(draws) / RESAMPLES
        if frequency >= STABLE:
            low, high = np.quantile(draws, (0.05, 0.95))
            unit = terms[names[index]][0]
            result.append(
                Term(names[index], float(coefficient), unit, float(low), float(high), frequency, float(share))
            )
    kept = [names.index(term.name) for term in result]
    explained = 1 - _unexplained(grams.sum(0), kept) if kept else 0.0
    return Law(sorted(result, key=lambda term: -term.share), explained)


def _gram(values: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Products of all terms (K, n, 3) and the acceleration (n, 3) with each other (K + 1, K + 1)."""
    columns = np.concatenate((values, acceleration[None])).reshape(len(values) + 1, -1)
    return columns @ columns.T


def _solve(gram: np.ndarray, chosen: list[int]) -> np.ndarray:
    return np.linalg.lstsq(gram[np.ix_(chosen, chosen)], gram[chosen, -1], rcond=1e-10)[0]


def _unexplained(gram: np.ndarray, chosen: list[int]) -> float:
    """Share of the square that the least-squares fit of some terms leaves."""
    if not chosen:
        return 1.0
    return 1 - float(gram[chosen, -1] @ _solve(gram, chosen)) / max(float(gram[-1, -1]), 1e-300)


def _sparse(gram: np.ndarray) -> tuple[list[int], np.ndarray, list[float]]:
    """Terms that stay, their coefficients, and what the loss of each would cost."""
    chosen = [index for index in range(len(gram) - 1) if gram[index, index] > 0]
    while chosen:
        whole = _unexplained(gram, chosen)
        costs = [_unexplained(gram, [other for other in chosen if other != index]) - whole for index in chosen]
        if min(costs) >= LEAST_SHARE:
            return chosen, _solve(gram, chosen), costs
        chosen.pop(int(np.argmin(costs)))
    return [], np.zeros(0), []
