"""Vary the stiffness of a felt, and plot how long the hammer touches the string.

    uv run python docs/examples/sweep_contact_duration.py [FOLDER]

Writes sweep_contact_duration.csv and sweep_contact_duration.png, beside the law of a hammer on a rigid wall: the
duration is proportional to stiffness ** (-1 / (exponent + 1)).
"""

import csv
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fdh

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
scene, rows = fdh.load("piano_c4"), []
for stiffness in np.geomspace(1e8, 1e11, 13).tolist():
    changed = scene.replace("contact.felt.stiffness", stiffness)
    rendering = fdh.render(changed, seconds=0.02, order=4, trace=True)
    rows.append({"stiffness": stiffness} | rendering.contacts["felt"].as_dict())
with open(folder / "sweep_contact_duration.csv", "w", newline="", encoding="utf-8") as file:
    writer = csv.DictWriter(file, rows[0])
    writer.writeheader()
    writer.writerows(rows)

stiffness, duration = (np.array([row[name] for row in rows]) for name in ("stiffness", "duration"))
law = duration[0] * (stiffness / stiffness[0]) ** (-1 / (scene.contact[0].exponent + 1))
figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
axes.loglog(stiffness, 1e3 * duration, "o-", label="hammer on a string")
axes.loglog(stiffness, 1e3 * law, "--", label="law of a rigid wall")
axes.set(xlabel="stiffness of the felt, N/m$^{2.5}$", ylabel="contact duration, ms")
axes.legend()
figure.savefig(folder / "sweep_contact_duration.png", dpi=90)
