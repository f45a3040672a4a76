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
# # Explore: add an effect and watch the error fall
#
# A light ball was thrown twice, and its centre was followed. The model knows gravity alone. What does it lack? This
# notebook asks by hand: it changes a setting, sees the error, asks what would help, and fits. The same calls are behind
# the page that `pacnerf-lpo explore` opens, which stands in the last cell. With a video nothing is different but the
# time that a simulation takes: `pacnerf_lpo.explore.Session.open("runs/demo_missing")`.

# %%
import os
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

if not Path("configs").is_dir():
    os.chdir("..")
sys.path.insert(0, os.getcwd())

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import show

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## Two throws with a secret
#
# Positions as a tracking program would write them, 60 a second, with a noise of 2 mm: free flight with a drag of 0.8 per
# second, which is solved in closed form.

# %%
DRAG, GRAVITY = 0.8, np.array([0.0, -9.81, 0.0])
random = np.random.default_rng(0)
lines = ["recording,time_s,x_m,y_m,z_m"]
for throw, velocity in enumerate(([2.0, 4.0, 0.3], [3.0, 3.0, -0.5])):
    for time in np.arange(0, 0.7, 1 / 60):
        shown = (1 - np.exp(-DRAG * time)) / DRAG
        place = [0.0, 1.5, 0.0] + np.array(velocity) * shown + GRAVITY / DRAG * (time - shown)
        x, y, z = place + 0.002 * random.standard_normal(3)
        lines.append(f"throw{throw},{time:.5f},{x:.5f},{y:.5f},{z:.5f}")
(folder / "throws.csv").write_text("\n".join(lines))
main(["init", str(folder / "throws.csv"), str(folder / "throws"), "--shape", "Ball", "--size", "0.04", "--mass", "0.0027"])

# %% [markdown]
# ## By hand
#
# A session opens what `init`, `fit` or `diagnose` wrote. Every change is a step of its history, simulated at once; its
# error is that of the fitted and of the held-out measurements.

# %%
session = Session.open(folder / "throws", jobs=1)
for drag in (0.3, 0.6, 0.9, 1.2):
    step = session.set("drag", drag)
    print(f"{step.name}: {step.fitted:.1f} {session.unit}")
tried = session.steps[1:]
plt.plot([step.values["drag"] for step in tried], [step.fitted for step in tried], "o-")
plt.xlabel("drag [1/s]")
plt.ylabel(f"error [{session.unit}]")

# %% [markdown]
# ## Ask
#
# Back at the first step, the session says what would help. Then the best is added and fitted, with the motion.

# %%
session.go_to(0)
for found in session.suggest(3):
    print(f"{found.readable}: odds 10^{found.log_bayes_factor / np.log(10):.0f}, {found.signature}")

# %%
session.set("drag", 0.6)
names = [setting.name for setting in session.settings if setting.active and setting.fitted]
step = session.fit(names)
low, high = step.intervals["drag"]
print(f"drag {step.values['drag']:.2f} 1/s, 90 % interval {low:.2f} to {high:.2f}; true: {DRAG}")

# %%
first, last = session.error(0), session.error(step.number)
plt.plot(first.times, first.by_frame_fitted, label="without drag")
plt.plot(last.times, last.by_frame_fitted, label="with drag")
plt.xlabel("time [s]")
plt.ylabel(f"error [{first.unit}]")
plt.legend()

# %% [markdown]
# ## The page
#
# The same session in a cell: drag sliders, tick suggestions, go back to any step. What is done there is seen here.

# %%
page = show(session, height=600)

# %% [markdown]
# `fit` and `diagnose` take what was found as an overlay.

# %%
print(session.save_overlay(folder / "effects.yaml").read_text())
page.close()
session.close()

# %%
assert abs(step.values["drag"] - DRAG) < 0.1 and step.fitted < 0.2 * session.steps[0].fitted
