# mypy: disable-error-code="valid-type,index"
"""One particle through the local laws of a material with effects, and their adjoint, in one float64 kernel."""

from collections.abc import Sequence

import torch
from torch import Tensor

from pacnerf_lpo.mpm.effects import Effect
from pacnerf_lpo.mpm.ground import Sticky
from pacnerf_lpo.mpm.materials import Material
from pacnerf_lpo.mpm.point import Evaluation, Point
from pacnerf_lpo.mpm.runtime import start
from pacnerf_lpo.mpm.simulator import local_laws
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti

FIXED = {"F": 9, "C": 9, "x": 3, "X": 3, "v": 3, "mass": 1, "stiffness": 1}


class Local:
    """The local laws as a function of one flat vector; its parts are named by :attr:`parts`, outputs by
    :attr:`outputs`.
    """

    def __init__(self, material: Material, effects: Sequence[Effect], t: float = 0.1, dt: float = 1e-3):
        self.material = material
        laws, self._values = local_laws(material, Sticky(), effects)
        H, names = laws.history, laws.names
        self.parts = {**FIXED, "history": H, **dict.fromkeys(names, 1)}
        self.outputs = {"F": 9, "tau": 9, "v": 3, "history": H}
        start()
        Reals = ti.types.ndarray(dtype=ti.f64, ndim=1)

        @ti.kernel
        def once(given: Reals, seeds: Reals, out: Reals, back: Reals):
            for _ in range(1):
                F = [[given[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
                C = [[given[9 + 3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
                x, X, v = [[given[18 + 3 * k + a] for a in ti.static(range(3))] for k in ti.static(range(3))]
                history = [given[29 + h] for h in ti.static(range(H))]
                coefficients = [given[29 + H + c] for c in ti.static(range(len(names)))]
                e = Evaluation(laws, Point(F, C, x, X, v, t, dt, given[27], 1.0, given[28], history), coefficients)
                gF = [[seeds[3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
                gtau = [[seeds[9 + 3 * i + j] for j in ti.static(range(3))] for i in ti.static(range(3))]
                gv, gh = (
                    [seeds[18 + a] for a in ti.static(range(3))],
                    [seeds[21 + h] for h in ti.static(range(H))],
                )
                g = e.pull_back(gF, gtau, gv, gh)
                for i, j in ti.static(ti.ndrange(3, 3)):
                    out[3 * i + j], out[9 + 3 * i + j] = e.F_new[i][j], e.tau[i][j]
                    back[3 * i + j], back[9 + 3 * i + j] = g.F[i][j], g.C[i][j]
                for a in ti.static(range(3)):
                    out[18 + a] = e.velocity[a]
                    back[18 + a], back[21 + a], back[24 + a] = g.x[a], g.X[a], g.v[a]
                back[27], back[28] = g.mass, g.stiffness
                for h in ti.static(range(H)):
                    out[21 + h], back[29 + h] = e.history[h], g.history[h]
                for c in ti.static(range(len(names))):
                    back[29 + H + c] = g.coefficients[c]

        self._launcher = Launcher(once, "f64")

    def inputs(self, **given: Tensor | float | Sequence[float]) -> Tensor:
        """The flat vector of a particle at rest in its undeformed state, with these parts changed."""
        guess = {name: torch.tensor(value, dtype=torch.float64) for name, value in self.material.guess.items()}
        for name in self.material.parameters:
            if name in given:
                guess[name] = torch.as_tensor(given.pop(name), dtype=torch.float64)
        values = {**self.material.coefficients(guess), **self._values, "F": torch.eye(3), "mass": 1.0, "stiffness": 1.0}
        values.update(given)
        assert set(values) <= set(self.parts)
        rows = [torch.as_tensor(values.get(k, [0.0] * n), dtype=torch.float64) for k, n in self.parts.items()]
        return torch.cat([row.reshape(n) for row, n in zip(rows, self.parts.values(), strict=True)])

    def __call__(self, inputs: Tensor, seeds: Tensor | None = None) -> tuple[dict[str, Tensor], Tensor]:
        """Outputs by name, and the gradient of sum(seeds * outputs) by the flat inputs."""
        size = sum(self.outputs.values())
        out, back = torch.zeros(size, dtype=torch.float64), torch.zeros_like(inputs)
        seeds = torch.zeros_like(out) if seeds is None else seeds
        self._launcher.bind(given=inputs, seeds=seeds, out=out, back=back)
        self._launcher()
        split = dict(zip(self.outputs, out.split(list(self.outputs.values())), strict=True))
        return {k: v.reshape(3, 3) if len(v) == 9 else v for k, v in split.items()}, back
