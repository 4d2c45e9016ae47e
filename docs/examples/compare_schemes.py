"""Compare the schemes exact and fdh at several orders and substeps with a refined reference: error and time.

    uv run python docs/examples/compare_schemes.py [FOLDER]

Writes compare_schemes.csv. The scheme fdh, of the paper, detunes modes, most the high ones. Order and substeps refine
the contact alone, so that only oversampling makes its error small.
"""

import csv
import sys
from pathlib import Path

import numpy as np

import fdh

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
scene, seconds = fdh.load("piano_c4"), 0.1
reference = fdh.render(scene, seconds, order=6, substeps=16).audio
settings = [{"scheme": "exact", "order": order, "substeps": n} for order in (2, 4) for n in (1, 2, 4)]
settings += [{"scheme": "fdh", "oversample": n} for n in (1, 4, 16)]

rows = []
for setting in settings:
    renderings = [fdh.render(scene, seconds, **setting) for _ in range(3)]
    rendering = min(renderings, key=lambda one: one.stats.ns_per_sample)  # the machine may be busy for a moment
    error = float(np.sqrt(np.mean((rendering.audio - reference) ** 2) / np.mean(reference**2)))
    chosen = {name: rendering.stats.accuracy[name] for name in ("scheme", "order", "substeps", "oversample")}
    rows.append(chosen | {"relative_error": error, "ns_per_sample": rendering.stats.ns_per_sample})
    print(f"{setting}: relative error {error:.1e}, {rendering.stats.ns_per_sample:.0f} ns per sample")
with open(folder / "compare_schemes.csv", "w", newline="", encoding="utf-8") as file:
    writer = csv.DictWriter(file, rows[0])
    writer.writeheader()
    writer.writerows(rows)
