"""A sound file: the gain that its sound gets, and what there is to say of it once it is there."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine.output_files import Clipping, apply_gain, count_clipped, describe_lowered_gain, save_audio


@dataclass(frozen=True)
class SoundFile:
    """A sound file to be written.

    subtype: FLOAT, PCM_24, PCM_16 or DOUBLE; that of the format if None
    gain:    dB on SI units; the sound is normalised if None
    """

    path: Path
    subtype: str | None = None
    gain: float | None = None

    def bring_to_level(self, audio: np.ndarray, samplerate: int, is_silent: bool = False) -> "LevelledSound":
        """Return a sound at the level of the file. audio: [frames, channels], SI units

        is_silent: all there is of it is rounding, which is not normalised
        """
        peak = float(abs(audio).max())
        levelled, gain = apply_gain(audio, 0.0 if is_silent else peak, self.gain, self.subtype)
        clipping = count_clipped(self.path, levelled, gain, self.subtype)
        return LevelledSound(self, levelled, samplerate, peak, gain, clipping)


@dataclass(frozen=True, eq=False)
class LevelledSound:
    """A sound at the level of its file."""

    file: SoundFile
    audio: np.ndarray  # [frames, channels]
    samplerate: int  # Hz
    peak: float  # before the gain: in SI units, but for a mix of several patches
    gain: float  # dB, that was applied
    clipping: Clipping | None  # of a file of integers

    def write(self) -> None:
        """Write the file. Raises OSError if it cannot be written, RuntimeError if its format cannot hold the sound."""
        save_audio(self.file.path, self.audio, self.samplerate, self.file.subtype)

    @property
    def warnings(self) -> list[str]:
        """A line for each thing that a listener may not expect: a lowered gain, and samples that are cut off."""
        lines = describe_lowered_gain(self.file.path, self.gain, self.file.gain)
        return lines + ([f"{self.file.path}: {self.clipping}"] if self.clipping else [])

    @property
    def statistics(self) -> dict[str, Any]:
        """The file and its sound by the names of `--json`."""
        return {
            "output": str(self.file.path),
            "seconds": len(self.audio) / self.samplerate,
            "samplerate": self.samplerate,
            "channels": self.audio.shape[1],
            "peak": self.peak,
            "peak_file": float(abs(self.audio).max()),
            "gain_db": self.gain,
            "clipped": self.clipping.count if self.clipping else 0,
        }
