# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The engine alone
#
# The simulator is one differentiable function: particles in, their positions at every video frame out. It needs neither
# video nor Lightning. Here a soft ball is dropped, the drop is differentiated, and the stiffness of the ball is found
# again from the positions of its particles.

# %%
import matplotlib.pyplot as plt
import torch

from pacnerf_lpo.data.shapes import Ball, fill
from pacnerf_lpo.mpm.ground import Separate
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator

torch.set_num_threads(1)

# %% [markdown]
# ## A ball in the air
#
# Grid spacing `dx` 8 cm, eight particles in each cell, so that a particle has the volume $(dx/2)^3$. The ball may leave the
# ground again, which makes it bounce.

# %%
dx, frames = 0.08, 12
positions = fill(Ball(radius=0.16), dx / 2, torch.Generator().manual_seed(0)) + torch.tensor([0.0, 0.5, 0.0])
count = len(positions)
velocity = torch.tensor([0.0, -1.0, 0.0]).expand(count, 3)
mass = torch.full((count,), 1000.0 * (dx / 2) ** 3)  # kg
stiffness = torch.ones(count)  # factor on the moduli of each particle
simulator = Simulator(NeoHookean(), Separate(), dx=dx, substeps=60)


def drop(E: torch.Tensor, nu: float = 0.3, velocity: torch.Tensor = velocity) -> torch.Tensor:
    """Positions at every frame [m, (frames, N, 3)]."""
    return simulator(positions, velocity, mass, stiffness, {"E": E, "nu": torch.tensor(nu)}, frames)


path = drop(torch.tensor(1e5))
print(f"{count} particles, {frames} frames of 1/24 s, {60 * frames} substeps")

# %%
figure, axes = plt.subplots(1, 6, figsize=(12, 3), sharex=True, sharey=True)
for axis, frame in zip(axes, range(0, frames, 2), strict=True):
    x, y, _ = path[frame].T
    axis.scatter(x, y, s=4, c=positions[:, 1], cmap="cividis")
    axis.axhline(0, color="0.6")
    axis.set(title=f"frame {frame}", aspect="equal", xlim=(-0.3, 0.3), ylim=(-0.05, 0.7), xlabel="x [m]")
axes[0].set_ylabel("y [m]")
figure.tight_layout()

# %% [markdown]
# ## Softer and stiffer

# %%
figure, axis = plt.subplots(figsize=(6, 3.2))
heights = {}
for young in (3e4, 1e5, 1e6):
    heights[young] = drop(torch.tensor(young))[..., 1].mean(1)
    axis.plot(torch.arange(frames) / 24, heights[young], marker="o", ms=3, label=f"E = {young / 1e3:.0f} kPa")
axis.set(xlabel="time [s]", ylabel="height of the centre [m]")
axis.legend(frameon=False)
figure.tight_layout()

# %% [markdown]
# ## Derivatives
#
# How does the height of the centre in the last frame depend on the stiffness? Backward gives it at the cost of about two
# more simulations, for this and for every other input at once. A finite difference agrees.

# %%
log_young = torch.tensor(5.0, requires_grad=True)  # log10 of E / Pa
throw = velocity.clone().requires_grad_()
final = drop(10.0**log_young, velocity=throw)[-1, :, 1].mean()
final.backward()

with torch.no_grad():
    step = 0.02
    above, below = (drop(torch.tensor(10.0 ** (5.0 + s)))[-1, :, 1].mean().item() for s in (step, -step))
by_difference = (above - below) / (2 * step)
print(f"d height / d log10 E: {log_young.grad.item():+.4f} m by adjoint, {by_difference:+.4f} m by difference")
print(f"d height / d vertical velocity: {throw.grad[:, 1].sum().item():+.4f} s")
# a central difference is off by step^2 / 6 times the third derivative, here a few per cent in a bounce
assert abs(log_young.grad.item() - by_difference) < 0.1 * abs(by_difference)

# %% [markdown]
# ## From motion to stiffness
#
# Suppose the particles' positions were measured. Starting three times too soft, Gauss-Newton with one unknown finds the
# stiffness: the derivative of all positions comes from one more simulation.

# %%
measured = path
guess, history = 4.5, []
for _ in range(6):
    with torch.no_grad():
        model, probe = drop(torch.tensor(10.0**guess)), drop(torch.tensor(10.0 ** (guess + 0.01)))
        residual, slope = model - measured, (probe - model) / 0.01
        history.append((guess, residual.square().mean().sqrt().item()))
        guess -= float((slope * residual).sum() / slope.square().sum())
for value, cost in history:
    print(f"E = {10**value / 1e3:7.2f} kPa   rms distance {1e3 * cost:8.4f} mm")

figure, axis = plt.subplots(figsize=(6, 3))
axis.plot([10**value / 1e3 for value, _ in history], marker="o")
axis.axhline(100, color="0.5", ls="--", label="true")
axis.set(xlabel="iteration", ylabel="E [kPa]", ylim=(0, 110))
axis.legend(frameon=False)
figure.tight_layout()
assert abs(guess - 5.0) < 0.01
