"""Make a labelled set of sounds for machine learning: each sound with the parameters that made it.

    uv run python docs/examples/labelled_set.py [FOLDER]

Writes a WAV file per sound with index.csv, and labelled_set.npz: `audio` [sounds, frames] in SI units, `parameters`
[sounds, parameters], `names` of the parameters, `features` [sounds, 2] (rms, and spectral centroid in Hz), and
`samplerate`. A run that was stopped goes on where it was. `fdh sweep --random 1000` draws values at random instead.
"""

import sys
from pathlib import Path

import numpy as np
import soundfile

import fdh

RATE = 16_000
VARIED = {
    "contact.felt.stiffness": np.geomspace(1e8, 1e11, 4),
    "contact.felt.on_at": [0.1, 0.12, 0.15],
    "body.hammer.velocity": [1.0, 2.0, 4.0],
}
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "labelled_set")
rows = fdh.run_sweep_rows(fdh.load("piano_c4"), VARIED, folder, seconds=0.5, samplerate=RATE)
done = [row for row in rows if row["status"] == "done"]
sounds = [soundfile.read(folder / row["file"], dtype="float32", always_2d=True)[0][:, 0] for row in done]
gains = [10 ** (row["gain_db"] / 20) for row in done]  # of the files, on SI units
np.savez(
    folder / "labelled_set.npz",
    audio=np.stack([sound / gain for sound, gain in zip(sounds, gains, strict=True)]),
    parameters=np.array([[row[name] for name in VARIED] for row in done]),
    names=np.array([*VARIED]),
    features=np.array([[row["rms"], row["centroid_hz"]] for row in done]),
    samplerate=RATE,
)
print(f"{len(done)} sounds in {folder}")
