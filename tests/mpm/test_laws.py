"""Stress and return mapping of one particle against closed forms, for the engine's laws and for the twin's."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from tests.mpm.local_law import EVALUATORS, Evaluator
from tests.mpm.scenes import BY_NAME, CASES, Case
from tests.mpm.twin import EYE

pytestmark = pytest.mark.usefixtures("small_threads")
NO_FLOW = torch.zeros(3, 3, dtype=torch.float64)
ELASTIC = 1e9
"""A yield stress that is never reached [Pa]."""
EXACT = 1e-11
"""Relative error of some hundred float64 operations at condition numbers of order one."""


@pytest.fixture(params=EVALUATORS)
def evaluate(request) -> Evaluator:
    """(law, parameters, F (3,3), C (3,3), dt, stiffness) -> (new F, Kirchhoff stress tau)."""
    return EVALUATORS[request.param]


def stretch(*values: float) -> Tensor:
    """Diagonal deformation gradient."""
    return torch.diag(torch.tensor(values, dtype=torch.float64))


def rotation(seed: int = 11) -> Tensor:
    """A random proper rotation."""
    q = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))[0]
    return q * torch.sign(torch.linalg.det(q))


def moduli(p: dict[str, float]) -> tuple[float, float]:
    """Shear and bulk modulus [Pa] of a case."""
    if "kappa" in p:
        return p["mu"], p["kappa"]
    return p["E"] / (2 * (1 + p["nu"])), p["E"] / (3 * (1 - 2 * p["nu"]))


def norm_deviator(tau: Tensor) -> float:
    """Frobenius norm of the stress deviator [Pa]."""
    return float((tau - torch.trace(tau) / 3 * EYE).norm())


def assert_deformed(law: str, new: Tensor, expected: Tensor) -> None:
    """The deformation gradient is as expected; a fluid keeps its determinant only."""
    if law == "Newtonian":
        new, expected = torch.linalg.det(new), torch.linalg.det(expected)
    torch.testing.assert_close(new, expected, rtol=0, atol=EXACT)


def scale(case: Case) -> float:
    """Stress that a strain of one would cause [Pa]."""
    return sum(moduli(case.parameters))


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_no_stress_at_rest_and_under_rotation(evaluate, case):
    for F in (EYE, rotation()):
        new, tau = evaluate(case.law, case.parameters, F, NO_FLOW)
        assert tau.abs().max() < EXACT * scale(case)
        assert_deformed(case.law, new, F)


@pytest.mark.parametrize("squeeze", [0.9, 1.05])
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_objectivity_and_isotropy(evaluate, case, squeeze):
    """tau(R F Q) = R tau(F) R^T and F_new(R F Q) = R F_new Q: a superposed rotation turns the result, a prior one
    leaves it.
    """
    R, Q = rotation(1), rotation(2)
    F = squeeze * (EYE + 0.08 * torch.roll(EYE, 1, 0) - 0.03 * rotation(4))
    C = 20 * rotation(5) - 5 * EYE
    new, tau = evaluate(case.law, case.parameters, F, C)
    new_turned, tau_turned = evaluate(case.law, case.parameters, R @ F @ Q, R @ C @ R.T)
    torch.testing.assert_close(tau_turned, R @ tau @ R.T, rtol=0, atol=EXACT * scale(case))
    assert_deformed(case.law, new_turned, R @ new @ Q)


@pytest.mark.parametrize("s", [0.7, 1.4])
def test_uniaxial_stretch_of_the_neo_hookean_solid(evaluate, s):
    """tau_11 = mu (s^2 - 1) + lambda ln s, tau_22 = tau_33 = lambda ln s."""
    p = BY_NAME["NeoHookean"].parameters
    mu, kappa = moduli(p)
    lam = kappa - 2 * mu / 3
    _, tau = evaluate("NeoHookean", p, stretch(1.0, s, 1.0), NO_FLOW)
    expected = stretch(lam * math.log(s), mu * (s**2 - 1) + lam * math.log(s), lam * math.log(s))
    torch.testing.assert_close(tau, expected, rtol=0, atol=EXACT * (mu + kappa))


@pytest.mark.parametrize("law", ["VonMises", "ViscoplasticVonMises"])
def test_uniaxial_stretch_below_yield_is_hencky_elastic(evaluate, law):
    """tau_11 = (2 mu + lambda) ln s, tau_22 = lambda ln s, and the deformation gradient is kept."""
    p = {**BY_NAME[law].parameters, "tau_y": ELASTIC}
    mu, kappa = moduli(p)
    lam = kappa - 2 * mu / 3
    F = stretch(1.25, 1.0, 1.0)
    new, tau = evaluate(law, p, F, NO_FLOW)
    torch.testing.assert_close(tau, math.log(1.25) * stretch(2 * mu + lam, lam, lam), rtol=0, atol=EXACT * (mu + kappa))
    torch.testing.assert_close(new, F, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", ["VonMises", "ViscoplasticVonMises", "DruckerPrager"])
def test_without_flow_the_deformation_gradient_is_kept_to_the_bit(law):
    """Else the rounding of every substep adds up: strains of stiff solids are small. Compressed, for the sand."""
    p = {**BY_NAME[law].parameters, "tau_y": ELASTIC}
    F = rotation(4) @ (0.8 * EYE + 0.01 * torch.roll(EYE, 1, 0)) @ rotation(5)
    new, _ = EVALUATORS["engine"](law, p, F, NO_FLOW)
    assert torch.equal(new, F)


@pytest.mark.parametrize("s", [0.8, 0.97])
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_hydrostatic_compression(evaluate, case, s):
    """F = s I: a pressure only, whatever the yield stress; no law yields under it."""
    mu, kappa = moduli(case.parameters)
    pressure = {
        "NeoHookean": -(mu * (s**2 - 1) + 3 * (kappa - 2 * mu / 3) * math.log(s)),
        "Newtonian": -kappa * (s**3 - s**-18),
    }.get(case.law, -3 * kappa * math.log(s))
    new, tau = evaluate(case.law, case.parameters, s * EYE, NO_FLOW)
    torch.testing.assert_close(tau, -pressure * EYE, rtol=EXACT, atol=EXACT * abs(pressure))
    assert_deformed(case.law, new, s * EYE)


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_stiffness_multiplies_the_moduli(evaluate, case):
    """Not the yield stress, the plastic viscosity or the friction angle."""
    elastic = {"E", "mu", "kappa"}
    stiffer = {k: 0.3 * v if k in elastic else v for k, v in case.parameters.items()}
    F, C = stretch(1.05, 0.9, 0.97), 20 * rotation(5) - 5 * EYE
    new, tau = evaluate(case.law, case.parameters, F, C, stiffness=0.3)
    expected_new, expected = evaluate(case.law, stiffer, F, C)
    torch.testing.assert_close(tau, expected, rtol=0, atol=EXACT * scale(case))
    assert_deformed(case.law, new, expected_new)


def test_newtonian_shear_stress_and_volume(evaluate):
    """tau = mu sym(grad v) at J = 1; J grows by det(I + dt grad v) and stops at 0.05."""
    p = BY_NAME["Newtonian"].parameters
    C = torch.zeros(3, 3, dtype=torch.float64)
    C[0, 1] = 7.0
    _, tau = evaluate("Newtonian", p, EYE, C)
    torch.testing.assert_close(tau, p["mu"] * (C + C.T) / 2, rtol=0, atol=EXACT * p["kappa"])
    new, _ = evaluate("Newtonian", p, EYE, stretch(30.0, -10.0, 20.0), dt=1e-3)
    assert float(torch.linalg.det(new)) == pytest.approx(1.03 * 0.99 * 1.02, rel=EXACT)
    new, _ = evaluate("Newtonian", p, EYE, stretch(-700.0, -700.0, -700.0), dt=1e-3)
    assert float(torch.linalg.det(new)) == pytest.approx(0.05, rel=EXACT)


def test_von_mises_yields_at_the_analytic_shear_strain(evaluate):
    """Pure shear (e^a, e^-a, 1): ||s|| = 2 sqrt(2) mu a reaches sqrt(2/3) tau_y at a = tau_y / (2 sqrt(3) mu)."""
    p = BY_NAME["VonMises"].parameters
    mu, _ = moduli(p)
    onset = p["tau_y"] / (2 * math.sqrt(3) * mu)
    for ratio in (0.5, 0.999999, 1.000001, 3.0):
        a = ratio * onset
        F = stretch(math.exp(a), math.exp(-a), 1.0)
        new, tau = evaluate("VonMises", p, F, NO_FLOW)
        kept = min(a, onset)
        torch.testing.assert_close(tau, 2 * mu * kept * stretch(1.0, -1.0, 0.0), rtol=0, atol=EXACT * mu)
        torch.testing.assert_close(new, stretch(math.exp(kept), math.exp(-kept), 1.0), rtol=0, atol=EXACT)


@pytest.mark.slow
@pytest.mark.parametrize("eta", [0.0, 5.0, 50.0])
def test_overstress_grows_with_plastic_viscosity(evaluate, eta):
    """Steady pure shear at rate r: each step adds ||2 mu de|| = 2 sqrt(2) mu r dt to ||s||, and the return map removes
    y / (1 + eta/(2 mu_hat dt)), so the trial overstress settles at y = 2 sqrt(2) mu r dt + sqrt(2) r eta mu / mu_hat,
    mu_hat = mu (e^2a + e^-2a + 1)/3 of the trial.
    """
    p = {**BY_NAME["ViscoplasticVonMises"].parameters, "eta": eta}
    mu, rate, dt = p["mu"], 30.0, 1e-4
    F, D = EYE, rate * stretch(1.0, -1.0, 0.0)
    for _ in range(400):
        F, tau = evaluate("ViscoplasticVonMises", p, F, D, dt=dt)
        F = F / torch.linalg.det(F) ** (1 / 3)  # the explicit update changes the volume by (r dt)^2 per step
    stretches = torch.linalg.svdvals((EYE + dt * D) @ F)
    mu_hat = mu * float((stretches**2).sum()) / 3
    trial = norm_deviator(2 * mu * torch.diag(stretches.log()))
    excess = trial - math.sqrt(2 / 3) * p["tau_y"]
    # First-order time stepping: ln(1 + r dt) differs from r dt by r dt / 2 = 1.5e-3, relative.
    assert excess == pytest.approx(math.sqrt(2) * rate * (2 * mu * dt + eta * mu / mu_hat), rel=2e-3)
    assert norm_deviator(tau) == pytest.approx(trial - excess / (1 + eta / (2 * mu_hat * dt)), rel=1e-6)


@pytest.mark.parametrize("theta", [15.0, 30.0, 45.0])
def test_sand_yields_at_its_friction_angle_in_triaxial_compression(evaluate, theta):
    """In triaxial compression (sigma_1 <= sigma_2 = sigma_3) the flowing stress obeys (t_1 - t_3) / (t_1 + t_3) = sin
    theta.
    """
    p = {**BY_NAME["DruckerPrager"].parameters, "theta": theta}
    F = stretch(math.exp(-0.14), math.exp(0.03), math.exp(0.03))
    new, tau = evaluate("DruckerPrager", p, F, NO_FLOW)
    axial, lateral = -float(tau[0, 0]), -float(tau[2, 2])
    assert (axial - lateral) / (axial + lateral) == pytest.approx(math.sin(math.radians(theta)), rel=1e-9)
    assert float(torch.linalg.det(new)) == pytest.approx(math.exp(-0.08), rel=EXACT), "flow keeps the volume"


def test_sand_is_elastic_inside_the_cone_and_stress_free_under_expansion(evaluate):
    p = BY_NAME["DruckerPrager"].parameters
    mu, kappa = moduli(p)
    F = stretch(math.exp(-0.101), math.exp(-0.1), math.exp(-0.099))
    new, tau = evaluate("DruckerPrager", p, F, NO_FLOW)
    expected = 3 * kappa * -0.1 * EYE + 2 * mu * stretch(-0.001, 0.0, 0.001)
    torch.testing.assert_close(tau, expected, rtol=0, atol=EXACT * (mu + kappa))
    torch.testing.assert_close(new, F, rtol=0, atol=EXACT)
    R = rotation()
    new, tau = evaluate("DruckerPrager", p, R @ stretch(1.2, 0.95, 1.0), NO_FLOW)
    assert tau.abs().max() == 0
    torch.testing.assert_close(new, R, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", ["VonMises", "ViscoplasticVonMises"])
def test_stretches_stop_at_one_twentieth(evaluate, law):
    p = {**BY_NAME[law].parameters, "tau_y": ELASTIC}
    new, _ = evaluate(law, p, stretch(0.01, 1.0, 1.2), NO_FLOW)
    torch.testing.assert_close(new, stretch(0.05, 1.0, 1.2), rtol=0, atol=EXACT)
