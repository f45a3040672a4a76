"""Trilinear gather and scatter."""

import pytest
import torch

from pacnerf_lpo.scene.trilinear import gather, scatter, stencil

SHAPE = (4, 5, 6)
NODES = 4 * 5 * 6
EPS64 = torch.finfo(torch.float64).eps


def random_points(count: int, seed: int = 0) -> torch.Tensor:
    """Positions inside the test grid, which starts at (1, 2, 3) m with spacing 0.5 m."""
    unit = torch.rand(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return torch.tensor([1.0, 2.0, 3.0]) + 0.5 * unit * (torch.tensor(SHAPE) - 1)


def stencil_of(positions: torch.Tensor):
    return stencil(positions, torch.tensor([1.0, 2.0, 3.0], dtype=positions.dtype), 0.5, SHAPE)


def node_positions() -> torch.Tensor:
    axes = [start + 0.5 * torch.arange(n, dtype=torch.float64) for start, n in zip((1, 2, 3), SHAPE, strict=True)]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).flatten(0, 2)


def test_weights_are_a_partition_of_unity():
    weights = stencil_of(random_points(100)).weights
    assert weights.min() >= 0
    torch.testing.assert_close(weights.sum(1), torch.ones(100, dtype=torch.float64), rtol=0, atol=8 * EPS64)


def test_gather_reproduces_a_trilinear_polynomial():
    def polynomial(p: torch.Tensor) -> torch.Tensor:
        return (2 + p[:, :1]) * (p[:, 1:2] - 3) * (1 - 0.5 * p[:, 2:])

    points = random_points(100)
    read = gather(polynomial(node_positions()), stencil_of(points))
    torch.testing.assert_close(read, polynomial(points), rtol=0, atol=200 * EPS64)


def test_upper_faces_belong_to_the_last_cell():
    values = torch.arange(NODES, dtype=torch.float64)[:, None]
    read = gather(values, stencil_of(node_positions()))
    torch.testing.assert_close(read, values, rtol=0, atol=NODES * EPS64)


def test_scatter_is_the_adjoint_of_gather():
    points = stencil_of(random_points(50))
    on_nodes, on_points = torch.randn(NODES, 3, dtype=torch.float64), torch.randn(50, 3, dtype=torch.float64)
    left, right = (gather(on_nodes, points) * on_points).sum(), (on_nodes * scatter(on_points, points)).sum()
    torch.testing.assert_close(left, right, rtol=0, atol=1000 * EPS64)


@pytest.mark.slow
@pytest.mark.parametrize(("operation", "rows"), [(gather, NODES), (scatter, 10)])
def test_derivatives(operation, rows):
    """Against float64 central differences, in the values and through the positions."""
    values = torch.randn(rows, 2, dtype=torch.float64, requires_grad=True)
    positions = random_points(10).requires_grad_()

    def function(v: torch.Tensor, p: torch.Tensor) -> torch.Tensor:
        return operation(v, stencil_of(p))

    assert torch.autograd.gradcheck(function, (values, positions))


def test_no_points_at_all():
    nothing = stencil_of(random_points(0))
    assert gather(torch.ones(NODES, 3, dtype=torch.float64), nothing).shape == (0, 3)
    assert scatter(torch.ones(0, 3, dtype=torch.float64), nothing).abs().sum() == 0


def test_no_channels_at_all_with_two_threads():
    """A body without colours: torch's own kernel refuses it as soon as two threads share the work."""
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        points = stencil_of(random_points(50_000))
        assert gather(torch.zeros(NODES, 0, dtype=torch.float64), points).shape == (50_000, 0)
        assert scatter(torch.zeros(50_000, 0, dtype=torch.float64), points).shape == (NODES, 0)
    finally:
        torch.set_num_threads(threads)
