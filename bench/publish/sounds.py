"""Small files of the sounds of the gallery."""

from pathlib import Path

import numpy as np
import soundfile

import engine
from bench.publish.report import ROOT
from engine.output_files import apply_gain

SOUNDS = ROOT / "docs" / "audio"
FADE = 0.01  # s, at the end of a sound that is cut off
LIMIT = 9e6  # bytes of all sounds


def hear(rendering: engine.Rendering, path: Path) -> None:
    """Write a small file of a rendering, normalised."""
    audio, _ = apply_gain(rendering.audio, float(rendering.stats["peak"]), None)
    compress(audio, rendering.samplerate, path)


def compress(audio: np.ndarray, samplerate: int, path: Path) -> None:
    """Write a small file of a sound [frames, channels], faded out at its end."""
    end = round(FADE * samplerate)
    audio[-end:] *= np.linspace(1.0, 0.0, end)[:, None]
    with soundfile.SoundFile(path, "w", samplerate, audio.shape[1], format="OGG", subtype="VORBIS") as file:
        for begin in range(0, len(audio), 4096):  # libsndfile loses its way in longer pieces
            file.write(audio[begin : begin + 4096])


def check_size() -> None:
    """Raise RuntimeError if all sounds take too much space."""
    size = sum(path.stat().st_size for path in SOUNDS.glob("*.ogg"))
    if size > LIMIT:
        raise RuntimeError(f"the sounds take {size / 1e6:.1f} MB, more than {LIMIT / 1e6:g}")
