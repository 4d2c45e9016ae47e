"""Render a shipped patch, save its sound, and plot its first contact.

    uv run python docs/examples/render_and_plot.py [FOLDER]

Writes render_and_plot.wav and render_and_plot.png: the force of the felt over time, and over its compression, where the
area of the loop is the energy that the felt loses.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fdh

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
scene = fdh.load("piano_c4").replace({"body.hammer.velocity": 4.0, "contact.felt.loss": 0.3})
rendering = fdh.render(scene, seconds=2.0, order=4, trace=True)
rendering.save(folder / "render_and_plot.wav")  # normalised to -1 dBFS
felt, trace = rendering.contacts["felt"], rendering.trace
print(felt)

time = trace["time"] - felt.first_touch
shown = (time > -0.5e-3) & (time < felt.first_duration + 0.5e-3)
column = trace["contacts"].tolist().index("felt")
force, ends = trace["force"][:, column], trace["compression"][:, column]
compression = (ends + np.roll(ends, 1)) / 2  # over the step before each sample, as the force
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True, layout="constrained")
left.plot(1e3 * time[shown], force[shown])
left.set(xlabel="time after first touch, ms", ylabel="force of the felt, N")
right.plot(1e3 * compression[shown], force[shown])
right.set(xlabel="compression, mm", xlim=(-0.1, None))
figure.savefig(folder / "render_and_plot.png", dpi=90)
