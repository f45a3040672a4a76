"""``pacnerf-lpo check``: whether an effect or a material of one's own keeps what its class promises."""

import inspect
import json
from importlib import import_module
from typing import Any

from pacnerf_lpo.config_errors import nearest
from pacnerf_lpo.errors import RunError, UserInputError
from pacnerf_lpo.mpm import effects, materials
from pacnerf_lpo.mpm.effects import Effect
from pacnerf_lpo.mpm.materials import Material, NeoHookean
from pacnerf_lpo.mpm.own_class import check_effect, check_material
from pacnerf_lpo.render import camera_faults


def run(name: str, arguments: str = "{}", material: Material | None = None) -> None:
    """Check an effect or a material before it is fitted to anything, in a few seconds: one line for each check.

    Of an effect: that it is described, that nothing changes where it vanishes, that each of its probes moves a small
    block, and that derivatives by its coefficients agree with differences. Of a material: that small strains meet the
    moduli which its parameters mean (E and nu, or mu and kappa [Pa]), that the moduli follow point.stiffness, that
    deformation costs work, that a body at rest stays at rest, and the derivatives by its parameters.

    example: pacnerf-lpo check magnetic.Magnetic

    example: pacnerf-lpo check stiffening.Stiffening --arguments '{"E": 3.0e+4}'

    Args:
        name: class path, such as magnetic.Magnetic, or the name of a class of the package.
        arguments: of the class, as JSON.
        material: that an effect acts on; elastic when not given.
    """
    made = _made(name, arguments)
    if isinstance(made, Material):
        checks = check_material(made)
    elif made.acts_on_motion:
        checks = check_effect(made, material or NeoHookean())
    else:
        raise UserInputError(f"check: {name} is a fault of a camera, which moves nothing; test it with a picture")
    count = failed = 0
    for check in checks:
        count, failed = count + 1, failed + (not check.kept)
        print(f"{'ok' if check.kept else 'FAILED':<7} {check.what}: {check.found}", flush=True)
    if failed:
        raise RunError(
            f"check: {failed} of {count} checks of {name} failed; see docs/own_effect.md, docs/own_material.md"
        )


def _made(name: str, arguments: str) -> Effect | Material:
    """An object of the class. Raises UserInputError."""
    module, _, kind = name.rpartition(".")
    try:
        homes = [import_module(module)] if module else [effects, materials, camera_faults]
        found: Any = next((getattr(home, kind) for home in homes if hasattr(home, kind)), None)
        given = json.loads(arguments)
    except UserInputError:
        raise
    except (ModuleNotFoundError, ValueError) as error:
        raise UserInputError(f"check {name}: {error}; modules are looked for here and among those installed") from error
    if not (isinstance(found, type) and issubclass(found, (Effect, Material))):
        known = [key for home in homes for key, v in vars(home).items() if inspect.isclass(v)]
        own = "" if module else "; a class of your own has its module before it, such as magnetic.Magnetic"
        raise UserInputError(f"check {name}: there is no effect or material of this name{own}{nearest(kind, known)}")
    try:
        return found(**given)
    except TypeError as error:
        remedy = "write it in the class" if inspect.isabstract(found) else "give its arguments with --arguments"
        raise UserInputError(f"check {name}: {error}; {remedy}") from error
