"""A sound file: the form that its sound gets, and what there is to say of it once it is there."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine.output_files import (
    NORMALISED_PEAK_DBFS,
    SILENT_PEAK,
    Clipping,
    Description,
    apply_gain,
    count_clipped,
    describe_lowered_gain,
    save_audio,
)
from engine.sound.about import About, add_chunks
from engine.sound.cut import Cut, fade_out, find_audible_frames, find_cut, make_loop
from engine.sound.form import PLAIN_FORM, SoundForm
from engine.sound.loudness import loudness_of

LOUDNESS_STEP = 0.01  # LU, that nobody hears


@dataclass(frozen=True, eq=False)
class CutSound:
    """A sound in SI units with its begin and end in place."""

    audio: np.ndarray  # [frames, channels]
    begin: int  # frames that were left out before it
    cut: Cut | None  # where it goes on beyond its end


def cut_sound(form: SoundForm, audio: np.ndarray, samplerate: int) -> CutSound:
    """Trim, repeat or fade a sound [frames, channels] as its form says."""
    begin, end = find_audible_frames(audio) if form.trim else (0, len(audio))
    cut = find_cut(audio, samplerate) if form.loop is None else None
    if begin or end < len(audio):
        audio = audio[begin:end]
    if form.loop is not None:
        audio = make_loop(audio, round(form.loop * samplerate))
    elif form.fades and (cut is not None or form.trim):
        audio = fade_out(audio, samplerate)
    return CutSound(audio, begin, cut)


@dataclass(frozen=True)
class SoundFile:
    """A sound file to be written."""

    path: Path
    form: SoundForm = PLAIN_FORM
    about: About | None = None

    def prepare(self, audio: np.ndarray, samplerate: int, is_silent: bool = False) -> "PreparedSound":
        """Return a sound in the form of the file. audio: [frames, channels], SI units

        is_silent: all there is of it is rounding, which is not normalised
        """
        peak, form = float(abs(audio).max()), self.form
        shaped = CutSound(audio, 0, None) if is_silent else cut_sound(form, audio, samplerate)
        audio, loudness, wanted = shaped.audio, None, form.gain
        largest = 0.0 if is_silent else float(abs(audio).max())
        if form.loudness is not None and largest > SILENT_PEAK:
            loudness = loudness_of(audio, samplerate)
            ceiling = NORMALISED_PEAK_DBFS - 20 * math.log10(largest)
            wanted = ceiling if loudness is None else min(ceiling, form.loudness - loudness)
        levelled, gain = apply_gain(audio, largest, wanted, form.subtype)
        clipping = count_clipped(self.path, levelled, gain, form.subtype)
        if loudness is not None:
            loudness += gain
        return PreparedSound(self, levelled, samplerate, peak, gain, clipping, shaped, loudness)


@dataclass(frozen=True, eq=False)
class PreparedSound:
    """A sound in the form of its file."""

    file: SoundFile
    audio: np.ndarray  # [frames, channels]
    samplerate: int  # Hz
    peak: float  # before the gain: in SI units, but for a mix of several patches
    gain: float  # dB, that was applied
    clipping: Clipping | None  # of a file of integers
    shaped: CutSound
    loudness: float | None  # LUFS, where a form asks for one

    def prepare_part(self, path: Path, audio: np.ndarray, about: About | None) -> "PreparedSound":
        """Return a part of this sound [frames, channels], with the same begin, end and gain; where this one is the sum
        of its parts in SI units, it is that of their files."""
        form, begin = self.file.form, self.shaped.begin
        if form.loop is not None:
            audio = make_loop(audio, round(form.loop * self.samplerate))
        else:
            audio = audio[begin : begin + len(self.audio)]
            if form.fades and (self.shaped.cut is not None or form.trim):
                audio = fade_out(audio, self.samplerate)
        levelled = audio * 10 ** (self.gain / 20)
        clipping = count_clipped(path, levelled, self.gain, form.subtype)
        file, peak = SoundFile(path, form, about), float(abs(audio).max(initial=0.0))
        return PreparedSound(file, levelled, self.samplerate, peak, self.gain, clipping, self.shaped, None)

    def write(self) -> None:
        """Write the file. Raises OSError if it cannot be written, RuntimeError if its format cannot hold the sound."""
        form, about = self.file.form, self.file.about
        description = None if about is None else Description(about.tags, lambda path: self._describe(path, about))
        save_audio(self.file.path, self.audio, self.samplerate, form.subtype, form.dither, description)

    def _describe(self, path: Path, about: About) -> None:
        add_chunks(path, about, self.samplerate, self.audio.shape, self.file.form.loop is not None)

    @property
    def is_limited(self) -> bool:
        """True if its peak keeps it from the loudness that the form asks for."""
        wanted = self.file.form.loudness
        return wanted is not None and self.loudness is not None and self.loudness < wanted - LOUDNESS_STEP

    @property
    def warnings(self) -> list[str]:
        """A line for each thing that a listener may not expect: where the sound is cut, a level that is another one,
        and samples that are cut off."""
        path, form = self.file.path, self.file.form
        lines = describe_lowered_gain(path, self.gain, form.gain)
        if self.shaped.cut is not None:
            lines.append(f"{path}: {self.shaped.cut}")
        if form.loudness is not None and self.loudness is None:
            lines.append(f"{path}: no loudness; the sound is silent")
        elif self.is_limited:
            limit = f"at {form.loudness:g} its peak would exceed {NORMALISED_PEAK_DBFS:g} dBFS"
            lines.append(f"{path}: {self.loudness:.1f} LUFS; {limit}")
        return lines + ([f"{path}: {self.clipping}"] if self.clipping else [])

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
            "loudness": self.loudness,
            "begin": self.shaped.begin / self.samplerate,
            "cut_db": None if self.shaped.cut is None else self.shaped.cut.level,
            "clipped": self.clipping.count if self.clipping else 0,
        }
