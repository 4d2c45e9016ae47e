"""Free sampled pianos, played by fluidsynth: what a computer has without a model.

Debian packages: fluidsynth, musescore-general-soundfont, fluid-soundfont-gm, timgm6mb-soundfont. Those not there are
left out.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

import soundfile

from bench.recordings.keys import layer_velocity
from bench.recordings.note import Sound

SOUNDS = Path("/usr/share/sounds")
FONTS = {
    "MuseScore General (sampled)": ("sf3/MuseScore_General.sf3", "sf3/MuseScore_General_Full.sf3"),
    "FluidR3 (sampled)": ("sf2/FluidR3_GM.sf2",),
    "TimGM6mb (sampled)": ("sf2/TimGM6mb.sf2",),
}
RATE = 44_100  # Hz
PAUSE = 2.0  # s between notes, in which the last one ends
TICKS_PER_SECOND = 960
DRUM_CHANNEL = 9  # of General MIDI, from 0

PlayNote = Callable[[int, int], Sound | None]  # of a key and a layer


def find_fonts() -> dict[str, Path]:
    """Sound fonts that are there, by name; none without fluidsynth."""
    if not shutil.which("fluidsynth"):
        return {}
    there = {name: [SOUNDS / file for file in files if (SOUNDS / file).exists()] for name, files in FONTS.items()}
    return {name: files[0] for name, files in there.items() if files}


def play_font(
    font: Path, notes: Iterable[tuple[int, int, float]], folder: Path, program: int = 0, channel: int = 0
) -> PlayNote:
    """Play notes of a sound font, dry, into a file in a folder, from which single ones are then read.

    notes: key, layer, and s; program: the instrument of General MIDI, from 0, a grand piano, or the kit on the channel
    of the drums. Raises subprocess.CalledProcessError if fluidsynth fails.
    """
    import mido

    track = mido.MidiTrack([mido.Message("program_change", program=program, channel=channel)])
    begins, now = dict[tuple[int, int], tuple[float, float]](), 0.0
    for key, layer, seconds in notes:
        pause = round(PAUSE * TICKS_PER_SECOND)
        on = {"note": key, "velocity": layer_velocity(layer), "channel": channel}
        track.append(mido.Message("note_on", **on, time=pause))
        length = round(seconds * TICKS_PER_SECOND)
        track.append(mido.Message("note_off", note=key, channel=channel, time=length))
        begins[key, layer] = (now + pause / TICKS_PER_SECOND, seconds)
        now += (pause + length) / TICKS_PER_SECOND
    score, wave = (folder / f"{font.stem}_{channel}_{program}.{kind}" for kind in ("mid", "wav"))
    mido.MidiFile(ticks_per_beat=TICKS_PER_SECOND // 2, tracks=[track]).save(score)
    options = ["-q", "-n", "-i", "-R", "0", "-C", "0", "-r", str(RATE), "-T", "wav", "-O", "s24", "-F", str(wave)]
    subprocess.run(["fluidsynth", *options, str(font), str(score)], check=True, capture_output=True)

    def play(key: int, layer: int) -> Sound | None:
        if (key, layer) not in begins:
            return None
        begin, seconds = (round(x * RATE) for x in begins[key, layer])
        audio, rate = soundfile.read(wave, start=begin, frames=seconds, always_2d=True)
        return audio, rate

    return play
