"""Matter of which nobody has said what it is: laws compete for it."""

from collections.abc import Sequence

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.drucker_prager import DruckerPrager
from pacnerf_lpo.mpm.materials.neo_hookean import NeoHookean
from pacnerf_lpo.mpm.materials.newtonian import Newtonian
from pacnerf_lpo.mpm.materials.viscoplastic_von_mises import ViscoplasticVonMises
from pacnerf_lpo.mpm.materials.von_mises import VonMises


class Auto(Material):
    """A material whose law the recording decides, once shape and velocity are known. Until then an elastic body stands
    in: its flight before contact hardly depends on the law.

    Args:
        laws: what competes, from the simple to the complex: of two that cannot be separated the first is used. None:
            elastic, viscous, granular, plastic and viscoplastic laws, with guesses from the speed of the impact. E
            and nu of grains are known, as in the papers: a heap slides, and hardly shows them.
    Raises:
        UserInputError: fewer than two laws, one of them twice, or Auto among them.
    """

    family = "not decided"
    parameters = NeoHookean.parameters
    coefficients = staticmethod(NeoHookean.coefficients)
    law = staticmethod(NeoHookean.law)

    def __init__(self, laws: Sequence[Material] | None = None):
        super().__init__(NeoHookean().guess)
        kinds = [type(law).__name__ for law in laws or ()]
        if laws is not None and (len(laws) < 2 or len(set(kinds)) < len(kinds) or Auto.__name__ in kinds):
            raise UserInputError(
                f"physics.material: Auto.laws = [{', '.join(kinds)}]; give at least two different laws, or none at all"
            )
        own = NeoHookean(), Newtonian(), DruckerPrager(known=("E", "nu")), VonMises(), ViscoplasticVonMises()
        self._given = laws is not None
        self.laws: tuple[Material, ...] = own if laws is None else tuple(laws)

    def guesses(self, pressure: float, time: float) -> list[Material]:
        """The laws, each where a search of its parameters begins: as the user guessed, else as shows best.

        Args:
            pressure, time: of the impact, as for :meth:`~pacnerf_lpo.mpm.parameters.Parameter.typical`.
        """
        if self._given:
            return list(self.laws)
        return [
            law.guessed({name: law.parameters[name].typical(pressure, time) for name in law.free_names})
            for law in self.laws
        ]
