"""Strike a body whose modes you have measured: frequencies, decay times and mode shapes from a CSV file.

    uv run python docs/examples/own_modes_from_csv.py [FOLDER]

Reads glass.csv in the folder, and writes it first if it is not there; writes own_modes_from_csv.wav.
"""

import sys
from pathlib import Path

import fdh

MODES = """frequency,t60,rim,wall
523.0,2.8,9.1,6.2
1304.0,1.9,8.3,-4.4
2411.0,1.2,7.7,3.0
3822.0,0.7,6.9,-2.1
"""  # Hz, s, and per point the mass-normalised mode shape, 1/√kg: 1/√(modal mass) where that was normalised to 1 there
folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
modes = folder.resolve() / "glass.csv"
if not modes.exists():
    modes.write_text(MODES, "utf-8")

glass = {"name": "glass", "kind": "modes", "file": str(modes)}
spoon = {"name": "spoon", "kind": "mass", "mass": 0.01, "displacement": -1e-3, "velocity": 0.5}
touch = {"name": "touch", "body": "spoon", "on": "glass", "on_at": "rim", "stiffness": 1e8, "exponent": 1.5}
ear = {"body": "glass", "at": "wall", "quantity": "velocity"}
scene = fdh.load({"body": [glass, spoon], "contact": [touch], "pickup": [ear]})
rendering = fdh.render(scene, seconds=2.0, order=4, trace=True)
print(rendering.contacts["touch"])
rendering.save(folder / "own_modes_from_csv.wav")
