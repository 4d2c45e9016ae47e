"""One gain for all sounds of a sweep, so that their levels compare. It is known only when the loudest is rendered:
until then sounds are kept in SI units, in a folder of their own."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from engine.output_files import NORMALISED_PEAK_DBFS, SILENT_PEAK, soundfile_path
from engine.sound.sound_file import SoundFile
from engine.sweep.index_csv import IndexRow

UNSCALED_FOLDER = "unscaled"  # in the folder of the sweep, until this is done


def common_gain(rows: Iterable[IndexRow]) -> float:
    """The gain, dB, that brings the loudest sound of an index to the usual peak; 0 if all are silent. It depends on
    nothing but the index, so that a sweep which goes on finds the same one again."""
    peak = max((float(row["peak"]) for row in rows if row["peak"] and not float(row["silent"] or 0)), default=0.0)
    return NORMALISED_PEAK_DBFS - 20 * math.log10(peak) if peak > SILENT_PEAK else 0.0


def sound_path(folder: Path, row: IndexRow) -> Path:
    """Return the path of the sound of a row in the folder of a sweep; sounds without a gain yet are in the subfolder
    for SI units."""
    return (folder if row["gain_db"] else folder / UNSCALED_FOLDER) / row["file"]


def rescale(source: Path, target: SoundFile, gain: float) -> None:
    """Write a sound, which has its begin and end, to a file with a gain, dB. Raises OSError or RuntimeError."""
    import soundfile

    audio, samplerate = soundfile.read(soundfile_path(source), always_2d=True)
    form = replace(target.form, gain=gain, trim=False, fade=False, loop=None)
    sound = replace(target, form=form).prepare(audio, samplerate)
    replace(sound, file=target).write()
