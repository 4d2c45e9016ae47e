"""Play a patch in an audio callback of your own, here with a tremolo on the sound.

    uv run python docs/examples/sounddevice_callback.py [FOLDER]

Plucks a tanpura once a second, and writes what was played to sounddevice_callback.wav.
"""

import math
import sys
from pathlib import Path

import numpy as np
import sounddevice
import soundfile

import fdh

RATE = 44_100
folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
folder.mkdir(parents=True, exist_ok=True)
player, played = fdh.Player(fdh.load("tanpura"), RATE, math.inf), []


def fill_block(out, frames, time, status):
    """Fill a block. It must return before the previous block has been played; other busy threads can delay it."""
    seconds = (player.frame + np.arange(frames)) / RATE
    out[:] = player.read(frames) * (0.75 + 0.25 * np.sin(2 * np.pi * 4.0 * seconds))[:, None]
    played.append(out.copy())


stream = sounddevice.OutputStream(RATE, blocksize=512, channels=player.channels, dtype="float32", callback=fill_block)
with stream:
    for strength in (0.5, 0.7, 1.0, 0.4):
        sounddevice.sleep(1000)  # ms
        player.pluck("string", strength)  # events may come from any thread
    sounddevice.sleep(1000)
soundfile.write(folder / "sounddevice_callback.wav", np.concatenate(played), RATE)
