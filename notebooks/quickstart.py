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
# # Quickstart: from video to material
#
# The package ships a small scene: an elastic bird that falls and bounces, filmed by eleven cameras. Three of them are
# enough to find its shape, its motion and how stiff it is. The settings here are as small as they can be, so that all of it
# takes about a minute: what comes out is a sketch. `make demo` does it properly in a few minutes.

# %%
import html
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch
from IPython.display import HTML, Markdown

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.evaluation.evaluate import evaluate_run
from pacnerf_lpo.evaluation.prediction import StateRenderer, predict
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.evaluation.tables import markdown_table
from pacnerf_lpo.report.residual_colours import comparison_panel
from pacnerf_lpo.report.turntable import Orbit, turntable

run_dir = Path(tempfile.mkdtemp()) / "quickstart"

# %% [markdown]
# ## Fit
#
# The same command as on a terminal, `pacnerf-lpo fit --config fit --config demo ...`: each `--config` changes what it
# names, and single values can be set after them.

# %%
small = {
    "data.image_scale": "0.25",
    "data.frames": "10",
    "data.train_views": "[0, 4, 8]",
    "data.test_views": "[3]",
    "physics.substep_rate": "1200",
    "physics.material.init_args.E": "3e4",
    "phases.static.init_args.rays_per_step": "512",
    "phases.static.init_args.length.init_args.steps": "160",
    "phases.static.init_args.length.init_args.scaling_steps": "[80]",
    "phases.static.init_args.length.init_args.halvings": "1",
    "phases.velocity.init_args.max_iterations": "8",
    "phases.physics.init_args.method.init_args.scan_decades": "0",
    "phases.physics.init_args.method.init_args.coarse_iterations": "1",
    "phases.physics.init_args.method.init_args.iterations": "4",
    "phases.correction.init_args.iterations": "5",
    "intervals": "false",  # they take longer than all of the rest
}
options = [word for key, value in small.items() for word in (f"--{key}", value)]
configs = ["--config", "fit", "--config", "demo"]
status = main(["fit", *configs, *options, "--outer_loop.run_dir", str(run_dir)])
assert status == 0

# %% [markdown]
# ## What was found
#
# The truth of this scene is known. It is opened only now, by the evaluation, and only because it is asked to.

# %%
results = evaluate_run(run_dir, truth="demo")
Markdown(markdown_table(results))

# %% [markdown]
# ## Look at it
#
# Rendered, measured, and their difference in a camera that the fit never saw. Orange: the model is darker than the video;
# blue: it is brighter.

# %%
run = Run(run_dir)
held_out = run.data.test[0]
images = torch.from_numpy(predict(run, run.last).images[held_out].copy()).float() / 255
frames = (0, 4, 6, 9)
figure, axes = plt.subplots(len(frames), 1, figsize=(7, 2.4 * len(frames)))
for axis, frame in zip(axes, frames, strict=True):
    axis.imshow(comparison_panel(images[frame], run.data.video.images[held_out, frame]))
    axis.set(title=f"frame {frame}: rendered | measured | residual", xticks=[], yticks=[])
figure.tight_layout()

# %% [markdown]
# ## Turn it in 3-D
#
# The fitted bird from sides where no camera stood, while it falls.

# %%
positions = torch.from_numpy(predict(run, run.last).positions.copy())
orbit = Orbit.around(positions, elevation=20.0, size=128)
azimuths, moments = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0], [0, 2, 4, 6, 8, 9]
figure, axes = plt.subplots(1, 6, figsize=(12, 2.4))
views = turntable(StateRenderer(run.last.state), positions, orbit, azimuths, moments)
for axis, view, azimuth in zip(axes, views, azimuths, strict=True):
    axis.imshow(view)
    axis.set(title=f"{azimuth:.0f}°", xticks=[], yticks=[])
figure.tight_layout()

# %% [markdown]
# The report of the run holds all of this and more, in one page: drag the particles with the mouse, move the sliders.

# %%
page = html.escape((run_dir / "report.html").read_text())
HTML(f'<iframe srcdoc="{page}" width="100%" height="900" style="border:1px solid #ccc"></iframe>')

# %%
error = results["truth_errors"]["E"]["error"]
print(f"E is off by {error:.2f} decades, after starting off by 0.52")
assert error < 0.5
