"""What competes to explain a residual: every hypothesis is a linear change of it, with a prior."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Hypothesis:
    """What an effect, a camera fault or a discrepancy would change in the residual.

    Coefficients are counted from the null in units of their prior standard deviation, so that the prior of each is
    N(0, 1). An effect that is not linear in its coefficient is tried at several sizes: each gives a straight line
    through the null, and the lines are alternatives with equal prior probability.

    name: of the hypothesis
    alternatives: changes of the residual by one prior standard deviation of every coefficient [(D, m) each]
    widths: prior standard deviation of every coefficient [its unit, (m,) for each alternative]
    one_sided: whether the (only) coefficient can only be positive
    spreads: prior standard deviations in units of the widths, with equal probability
    """

    name: str
    alternatives: tuple[np.ndarray, ...] = field(repr=False)
    widths: tuple[np.ndarray, ...]
    one_sided: bool = False
    spreads: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        for change, widths in zip(self.alternatives, self.widths, strict=True):
            if change.ndim != 2 or change.shape[1] != len(widths):
                raise ValueError(
                    f"hypothesis {self.name}: change {change.shape} has not one column for each of {widths}"
                )
            if self.one_sided and len(widths) > 1:
                raise ValueError(f"hypothesis {self.name}: only a single coefficient can be one-sided")

    @staticmethod
    def of_probes(
        name: str,
        change: np.ndarray,
        sizes: np.ndarray,
        width: np.ndarray,
        one_sided: bool,
        components: int = 1,
        spreads: tuple[float, ...] = (1.0,),
    ) -> Hypothesis:
        """From simulated changes at finite sizes.

        Args:
            name: of the effect
            change: measurement with the effect minus measurement without it (D, n)
            sizes: of the coefficient in each column, counted from the null [its unit, (n,)]
            width: prior standard deviation of the coefficient of each column [its unit, (n,)]
            one_sided: whether the coefficient can only lie on the side of the null on which the sizes are
            components: so many columns one after the other are components of one effect (a force along x and z); the
                next so many, another size of it
            spreads: prior standard deviations in units of the widths, with equal probability
        """
        signs = np.sign(sizes) if one_sided else np.ones_like(sizes)
        scaled, signed = change * (width / np.abs(sizes) * np.sign(sizes) * signs), width * signs
        parts = [slice(start, start + components) for start in range(0, len(sizes), components)]
        columns, widths = tuple(scaled[:, part] for part in parts), tuple(signed[part] for part in parts)
        return Hypothesis(name, columns, widths, one_sided, spreads)
