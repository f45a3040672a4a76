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
# # Missing physics: from a residual to a repaired model
#
# A body falls, a model is fitted, and the two do not agree. Which physical effect does the model lack? Here the answer is
# known, because the recording is made on the spot: a soft, light body in air. The model knows nothing of the air.
#
# So that all of it takes a minute, everything is small: some hundred particles, five cameras of 64 x 64 pixels, four
# candidates, and a body whose shape is known but for a small distortion. With a video, the shape comes from a
# reconstruction, and `pacnerf-lpo diagnose` tries every effect that the package knows; that takes minutes (`make demo`).
# What is done with the outlines is the same.

# %%
import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
import yaml
from IPython.display import Markdown

if not Path("configs").is_dir():
    os.chdir("..")
sys.path.insert(0, os.getcwd())

from validation.hidden_effects.film import film
from validation.hidden_effects.known_shape import KnownShape
from validation.hidden_effects.setting import Size, draw_setting
from pacnerf_lpo.diagnosis.catalogue import read_candidates
from pacnerf_lpo.diagnosis.diagnose import Options, investigate
from pacnerf_lpo.diagnosis.localising import excess
from pacnerf_lpo.diagnosis.overlay import overlay
from pacnerf_lpo.diagnosis.screening import judge, probe
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.identification.forward_model import MARGIN
from pacnerf_lpo.mpm.effects import LinearDrag
from pacnerf_lpo.report.diagnosis_result import summary

torch.set_num_threads(1)
folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## A recording with a secret
#
# The scene is drawn at random: shape, stiffness, throw and cameras. It is filmed with air drag of 3 per second, by a
# simulation with a finer grid, other particles and shorter steps than the model will have, and with noisy mattes.

# %%
DRAG = 3.0  # 1/s
random = np.random.default_rng(5)
size = Size(particles=800, views=5, held=2, frames=10, image_size=64)
setting, true = draw_setting(random, size, "NeoHookean")
recorded = film(setting, {**true, "drag": DRAG}, [LinearDrag(DRAG)], random, size.finer)
problem = KnownShape.seen("a body in air", setting, recorded.silhouettes, recorded.brightness)
print(f"{setting.shape}, E = {true['E'] / 1e3:.0f} kPa, views {setting.held_views} are held out")

# %% [markdown]
# ## Diagnose
#
# Candidates are a list of effects, as `physics.effects` in a configuration has them. Each outline is summarised by ten
# silhouette moments (centroid, area, widths, edges), and then:
#
# 1. *compare*: the model is fitted as it is to some of the cameras and frames. Null replicates, which are simulations of
#    the fitted model on other grids with other particles and fresh noise, give the covariance of its residual where
#    nothing is missing;
# 2. *localise*: where, in views and frames, the residual is larger;
# 3. *screen*: one simulation for each candidate gives the log Bayes factor of its linear change. An unknown smooth force
#    and a wrong shape compete as well;
# 4. *refit*: the candidates that could win are fitted with all other parameters. One is added if the best of all
#    candidates reaches its log Bayes factor by chance in less than 1 % of recordings in which nothing is missing.
#
# With `effects=2` the same would be repeated with the first effect in the model.

# %%
candidates = [{"class_path": name} for name in ("LinearDrag", "GravityMagnitude", "UniformForce", "KelvinVoigt")]
list_file = folder / "candidates.yaml"
list_file.write_text(yaml.safe_dump(candidates))
options = Options(candidates=str(list_file), effects=1, replicates=8)
rounds = investigate(problem, Store(folder, b"a body in air", asdict(options)), options, lambda text: None)
verdict = summary(problem, rounds)["verdict"]
Markdown("\n\n".join([f"**{verdict['sentence']}**", *verdict["details"]]))

# %% [markdown]
# The effects that were fitted with all other parameters. The cost is the weighted sum of squares of what is left; the
# p-value is that of the whole procedure, the choice of the best candidate included.

# %%
rows = ["| effect | cost without | with | log Bayes factor | p |", "|---|---|---|---|---|"]
for refit in rounds[0].refits:
    costs = f"{refit.cost_without:.0f} | {refit.cost:.0f}"
    rows.append(f"| {refit.name} | {costs} | {refit.log_bayes_factor:.1f} | {refit.p_value:.1g} |")
others = rounds[0].indistinguishable
print("not separated by this recording:", " and ".join(others) if len(others) > 1 else "none")
Markdown("\n".join(rows))

# %% [markdown]
# ## Where the model fails, and where it does no more
#
# From here on with linear drag, the hidden effect.
#
# Outlines in a camera that was not fitted: recorded (grey), the model without the effect (orange), and with it (blue).

# %%
first = rounds[0].comparison
repaired = next(again for again in rounds[0].refits if again.name == "LinearDrag")
effects = (*rounds[0].effects, rounds[0].candidate("LinearDrag").effect)
before = problem.model(rounds[0].effects, first.known)
after = problem.model(effects, repaired.known)
view = setting.held_views[0]
outlines = [model.outlines(model.path(model.start), model.start, [view])[0] for model in (before, after)]
frames = (1, 3, 5, 7, 9)
figure, axes = plt.subplots(1, len(frames), figsize=(12, 2.8))
for axis, frame in zip(axes, frames, strict=True):
    axis.imshow(recorded.silhouettes[view, frame].numpy(), cmap="Greys", vmax=2)
    for outline, colour in zip(outlines, ("tab:orange", "tab:blue"), strict=True):
        axis.contour(outline[frame, MARGIN:-MARGIN, MARGIN:-MARGIN].numpy(), [0.5], colors=colour)
    axis.set(title=f"frame {frame}", xticks=[], yticks=[])
figure.tight_layout()

# %% [markdown]
# The error beyond the noise floor, by view and frame. Framed rows and columns were never fitted.

# %%
errors = [np.sqrt(np.clip(excess(residual, first), 0, None)) for residual in (first.residual, repaired.residual)]
figure, axes = plt.subplots(1, 2, figsize=(11, 2.6), sharey=True)
for axis, error, title in zip(axes, errors, ("without the effect", "with it"), strict=True):
    shown = axis.imshow(error, cmap="magma", vmin=0, vmax=np.nanmax(errors[0]), aspect="auto")
    for held in setting.held_views:
        axis.add_patch(plt.Rectangle((-0.45, held - 0.45), error.shape[1] - 0.1, 0.9, fill=False, ec="white"))
    axis.add_patch(plt.Rectangle((error.shape[1] - 2.45, -0.45), 1.9, error.shape[0] - 0.1, fill=False, ec="white"))
    axis.set(title=title, xlabel="frame")
axes[0].set_ylabel("view")
_ = figure.colorbar(shown, ax=axes, label="excess error [pixels]")

# %% [markdown]
# A model that lacks an effect pays with its other parameters: the best stiffness without drag is not that of the body.

# %%
rows = ["| | true | without drag | with drag |", "|---|---|---|---|"]
for name in ("E", "v_y"):
    rows.append(f"| {name} | {true[name]:.4g} | {first.known[name]:.4g} | {repaired.known[name]:.4g} |")
rows.append(f"| drag | {DRAG} | | {repaired.known.get('drag', float('nan')):.3g} |")
Markdown("\n".join(rows))

# %% [markdown]
# ## Which effect it is, and which it is not
#
# The log Bayes factor of each hypothesis by its linear change: the natural logarithm of how many times more probable the
# recording is with it than without. The dashed line is exceeded by chance, by the best of them, in one of a hundred
# recordings in which nothing is missing.

# %%
screening = rounds[0].screening
figure, axis = plt.subplots(figsize=(7, 2.4))
names = [score.name for score in screening.scores][::-1]
axis.barh(names, [score.log_bayes_factor for score in screening.scores][::-1], color="tab:blue")
axis.axvline(screening.threshold, color="0.3", ls="--")
axis.set(xlabel="log Bayes factor")
figure.tight_layout()

# %% [markdown]
# ## The repaired model
#
# This overlay is what `pacnerf-lpo diagnose` writes as `effects.yaml`. Given after the configuration of the run,
# `pacnerf-lpo fit --config run.yaml --config effects.yaml` identifies material and effect together, and LPO goes on.

# %%
Markdown(f"```yaml\n{overlay(problem, effects, repaired.known)}```")

# %% [markdown]
# ## An effect of one's own
#
# One class, in one file. Its base class says where it acts; the function is plain arithmetic, and its derivatives are made
# by the package. Here: a fan on the ground, whose wind fades with height.

# %%
(folder / "fan.py").write_text('''
from pacnerf_lpo.mpm.differentiation import exp
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter

REACH = 0.3  # m


class Fan(BodyForce):
    """Upward acceleration b exp(-y / 0.3 m).

    Args:
        blow: b [m/s^2].
    """

    parameters = {"blow": Parameter("blow", "m/s^2", Identity(), (-100.0, 100.0), "acceleration by the fan")}
    null = {"blow": 0.0}
    signature = "the fall slows down near the ground only"
    confused_with = ("LinearDrag", "GravityMagnitude")
    separating_experiment = "the same drop without the fan"
    probes = ({"blow": 0.5}, {"blow": 2.0})

    def __init__(self, blow: float = 0.0):
        super().__init__({"blow": blow})

    @staticmethod
    def acceleration(point, c):
        return [0.0, c.blow * exp(-point.x[1] / REACH), 0.0]
''')
sys.path.insert(0, str(folder))  # on a terminal: PYTHONPATH

# %% [markdown]
# One line of configuration, in the list of candidates (or in `physics.effects`, to have it in a model from the start). It
# is screened with the others, by the same score:

# %%
list_file.write_text(yaml.safe_dump([*candidates, {"class_path": "fan.Fan"}]))
material = problem.physics.material
tried = read_candidates(list_file, material, ())
again = judge(problem, first, probe(problem, rounds[0].effects, first, tried, lambda text: None))
for score in again.scores:
    print(f"{score.name:18s} log Bayes factor {score.log_bayes_factor:7.1f}")

# %% [markdown]
# ## With a video
#
# ```sh
# pacnerf-lpo diagnose runs/mine                                     # every known effect, every camera
# pacnerf-lpo diagnose runs/mine --candidates my_candidates.yaml     # those of a list
# ```
#
# `runs/mine/diagnosis/diagnosis.html` shows what this notebook shows, and more.

# %%
by_name = {score.name: score.log_bayes_factor for score in again.scores}
assert "Fan" in by_name and by_name["LinearDrag"] > screening.threshold
assert repaired.p_value < 0.01 and "LinearDrag" in rounds[0].indistinguishable
