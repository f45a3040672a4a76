"""The engine's own promises: laws as plain functions, checkpoints, null effects, checks, and the documented example."""

import doctest
from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import rollout, runtime
from pacnerf_lpo.mpm import simulator as simulator_module
from pacnerf_lpo.mpm.effects import LinearDrag
from pacnerf_lpo.mpm.ground import Separate, Sticky
from pacnerf_lpo.mpm.materials import DruckerPrager, NeoHookean
from pacnerf_lpo.mpm.materials.common import kept_share
from pacnerf_lpo.mpm.principal import symmetric_eigen
from pacnerf_lpo.mpm.simulator import Simulator

pytestmark = pytest.mark.usefixtures("small_threads")
AXIS = torch.arange(4, dtype=torch.float64) * 0.05 + 0.02


def positions() -> torch.Tensor:
    """64 particles just above the ground [m, (64, 3)]."""
    return torch.cartesian_prod(AXIS, AXIS, AXIS)


def gradient_of(memory: float) -> torch.Tensor:
    """Gradient of a rollout by the initial positions, with a memory budget [bytes]."""
    simulator = Simulator(NeoHookean(), dx=0.1, substeps=8, frame_dt=1 / 120, dtype="f64", memory=memory)
    x = positions().requires_grad_()
    ones = torch.ones(64, dtype=torch.float64)
    path = simulator(
        x, -2 * torch.ones_like(x.detach()), 0.1 * ones, ones, {"E": torch.tensor(1e5), "nu": torch.tensor(0.3)}, 5
    )
    path.square().sum().backward()
    return x.grad


def test_documented_example_runs():
    """The example in Simulator's docstring gives what it prints."""
    result = doctest.testmod(simulator_module)
    assert result.attempted > 5
    assert result.failed == 0


@pytest.mark.slow
def test_recomputed_frames_give_the_very_same_gradient():
    """With memory for one frame the others are recomputed from checkpoints: the same operations, the same bits."""
    assert torch.equal(gradient_of(1.0), gradient_of(1e9))


@pytest.mark.slow
def test_one_slice_and_several_agree(monkeypatch):
    """In the calling thread or in two others: the same sums in another order."""
    several = gradient_of(1e9)
    monkeypatch.setattr(rollout, "LEAST_PARTICLES", 64)
    assert torch.allclose(gradient_of(1e9), several, rtol=1e-9)


def test_shortened_deviator():
    """A flow rule is a plain function: evaluated on floats, a deviator of norm 4 less 1 is three quarters of it."""
    assert kept_share(4.0, 1.0) == pytest.approx(0.75, rel=1e-15)
    assert kept_share(0.0, 0.0) == 1.0


def test_friction_cone_on_floats():
    """Coulomb: a fall of 1 m/s on friction 0.5 takes 0.5 m/s from a slide of 2 m/s, and all of one of 0.3 m/s."""
    c = SimpleNamespace(friction=0.5)
    assert Separate.velocity([2.0, -1.0, 0.0], c) == pytest.approx([1.5, 0.0, 0.0])
    assert Separate.velocity([0.0, -1.0, 0.3], c) == pytest.approx([0.0, 0.0, 0.0])
    assert Separate.velocity([2.0, 1.0, 0.3], c) == pytest.approx([2.0, 1.0, 0.3])


@pytest.mark.slow
def test_a_drag_of_zero_changes_nothing():
    """The null value of the effect reproduces the simulation without it, bit for bit."""
    x, ones = positions(), torch.ones(64, dtype=torch.float64)
    run = {"dx": 0.1, "substeps": 8, "frame_dt": 1 / 120, "dtype": "f64"}
    inputs = (x, -torch.ones_like(x), 0.1 * ones, ones, {"E": torch.tensor(1e5), "nu": torch.tensor(0.3)}, 4)
    plain = Simulator(NeoHookean(), **run)(*inputs)
    with_null = Simulator(NeoHookean(), effects=[LinearDrag(LinearDrag.null["drag"])], **run)(*inputs)
    with_drag = Simulator(NeoHookean(), effects=[LinearDrag(5.0)], **run)(*inputs)
    assert torch.equal(plain, with_null)
    assert (with_drag - plain)[-1, :, 0].mean() > 1e-4


def test_settings_are_checked_before_running():
    """Every unusable setting is named in one line."""
    with pytest.raises(UserInputError, match="friction = -1"):
        Separate(friction=-1.0)
    with pytest.raises(UserInputError, match="Young's modulus"):
        NeoHookean(E=-1.0)
    with pytest.raises(UserInputError, match="'nue' is no parameter"):
        NeoHookean(known=["nue"])
    with pytest.raises(UserInputError, match="dtype 'f16'"):
        Simulator(NeoHookean(), dx=0.1, substeps=8, dtype="f16")
    with pytest.raises(UserInputError, match="two parameters 'drag'"):
        Simulator(NeoHookean(), dx=0.1, substeps=8, effects=[LinearDrag(), LinearDrag()])
    with pytest.raises(UserInputError, match="did you mean 'nu'"):
        x, ones = positions(), torch.ones(64)
        values = {"E": torch.tensor(1e5), "nu": torch.tensor(0.3), "nus": torch.tensor(0.3)}
        Simulator(NeoHookean(), Sticky(), dx=0.1, substeps=8)(x, 0 * x, ones, ones, values, 2)


def test_known_parameters_are_not_free():
    """The trophy's setting: only the friction angle is identified."""
    assert DruckerPrager(known=["E", "nu"]).free_names == ["theta"]


def principal_cases(kind: str) -> torch.Tensor:
    """Symmetric tensors Q diag(l) Qᵀ with eigenvalues that are apart, nearly equal, partly or all equal [(500, 3,
    3)].
    """
    generator = torch.Generator().manual_seed(3)
    rotations = torch.linalg.qr(torch.randn(500, 3, 3, generator=generator, dtype=torch.float64))[0]
    noise = torch.rand(500, 3, generator=generator, dtype=torch.float64)
    values = {
        "apart": 0.1 + 3 * noise,
        "decades": 10 ** (4 * noise - 2),
        "nearly equal": 1 + 1e-7 * noise,
        "two equal": 1 + noise * torch.tensor([0.0, 0.0, 1.0]),
        "equal": 1 + 0 * noise,
    }[kind]
    tensor = (rotations * values[:, None]) @ rotations.mT
    return 0.5 * (tensor + tensor.mT)


@pytest.mark.filterwarnings("ignore:.*non-taichi function:SyntaxWarning")
@pytest.mark.parametrize("kind", ["apart", "decades", "nearly equal", "two equal", "equal"])
def test_eigen_solver_is_accurate_to_rounding(kind):
    """Residual and orthogonality within 16 units of rounding of the largest entry: some 100 operations, random
    signs.
    """
    runtime.start("cpu")
    numbers = runtime.ti.types.ndarray(dtype=runtime.ti.f32, ndim=3)

    @runtime.ti.kernel
    def solve(b: numbers, vectors: numbers, values: numbers):
        for p in range(b.shape[0]):
            value, U = symmetric_eigen([[b[p, i, j] for j in range(3)] for i in range(3)])
            for i in runtime.ti.static(range(3)):
                values[p, 0, i] = value[i]
                for j in runtime.ti.static(range(3)):
                    vectors[p, i, j] = U[i][j]

    b = principal_cases(kind).float()
    vectors, values = torch.zeros(500, 3, 3), torch.zeros(500, 1, 3)
    solve(b, vectors, values)
    U, rounding = vectors.double(), torch.finfo(torch.float32).eps
    assert ((U * values.double()) @ U.mT - b.double()).abs().max() < 16 * rounding * b.abs().max()
    assert (U.mT @ U - torch.eye(3)).abs().max() < 16 * rounding
