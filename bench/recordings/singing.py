"""How clearly plucked strings on a curved bridge sing: the power on harmonics over that in the gaps between them.

A string that wraps around its bridge and unwraps in the same way in each period has only harmonics; one that chatters
on it fills the gaps with noise.
"""

import sys
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import engine
from bench.publish.report import publish
from bench.recordings.keys import key_frequency, key_name
from bench.recordings.measure import Frames, decibels, from_onset, spectra
from bench.recordings.note import Sound
from bench.recordings.peers import find_fonts, play_font
from engine.patch.note_scene import scene_of_note

RATE = 44_100  # Hz
WINDOWS = Frames(length=0.2, hop=0.15, begin=0.03, seconds=1.07)  # from 30 ms to 1.1 s after the onset
SECONDS = 1.25
LOWEST, HIGHEST = 1000.0, 4000.0  # Hz
NEAR = 0.25  # of the distance of harmonics: what is nearer to one belongs to it
TUNING = np.arange(-40, 41, 2)  # cents off the key, in which the fundamental is sought
FIZZ_EDGE = 12_000.0  # Hz
WANTED = 28.0  # dB, in each window of each key: what recorded sitars have at least

VELOCITIES = (30, 80, 120)  # MIDI
RECORDED, RECORDED_KEY, PROGRAM, RECORDED_LAYER = "FluidR3 (sampled)", 48, 104, 12
PATCHES: dict[str, Iterable[int]] = {"sitar": range(48, 73), "tanpura_body": (36, 43, 48), "tanpura": (48,)}
HEADER = [
    "note",
    *(f"harmonics over gaps at MIDI {velocity}, dB: least, mean" for velocity in VELOCITIES),
    "fundamental whose harmonics fit best, cents off the key",
    "power above 12 kHz of all, dB, at most",
]


class Singing(NamedTuple):
    """What is measured of a note."""

    levels: np.ndarray  # dB [windows]
    cents: float  # of the fundamental, off its key
    fizz: float  # power above 12 kHz of all, dB


def harmonics_over_gaps(audio: np.ndarray, rate: float, f0: float) -> np.ndarray:
    """Power on harmonics over the power in the gaps between them, from 1 to 4 kHz, dB [windows].

    Half of the frequencies, those within a quarter of f0 of a multiple of f0, count as harmonics, and the others as
    gaps: noise has 0 dB. The windows, of 0.2 s each, lie from 30 ms to 1.1 s after the onset.
    audio: [frames, channels]; f0: fundamental, Hz
    """
    frequency, powers = window_powers(audio, rate)
    return np.asarray(ratio_of_powers(frequency, powers, f0))


def window_powers(audio: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of the bins from 1 to 4 kHz, and powers of all channels together [windows, bins]."""
    frequency, spectrum = spectra(from_onset(audio, rate, WINDOWS.begin), rate, WINDOWS)
    within = (frequency >= LOWEST) & (frequency <= HIGHEST)
    return frequency[within], np.sum(np.abs(spectrum[..., within]) ** 2, axis=1)


def ratio_of_powers(frequency: np.ndarray, powers: np.ndarray, f0: float) -> np.ndarray:
    """Power on multiples of f0 over that between them, dB [windows]. powers: [windows, bins]"""
    order = frequency / f0
    on_line = np.abs(order - np.round(order)) < NEAR
    return decibels((powers[:, on_line].sum(axis=1) + 1e-30) / (powers[:, ~on_line].sum(axis=1) + 1e-30))


def power_above(audio: np.ndarray, rate: float, edge: float = FIZZ_EDGE) -> float:
    """Power above a frequency, Hz, over all of it, dB. audio: [frames, channels]"""
    power = np.sum(np.abs(np.fft.rfft(audio, axis=0)) ** 2, axis=1)
    above = np.fft.rfftfreq(len(audio), 1 / rate) > edge
    return float(decibels(np.asarray((power[above].sum() + 1e-30) / (power.sum() + 1e-30))))


def measure_singing(sound: Sound, key: int) -> Singing:
    """Measure a note at the fundamental near its key whose multiples hold most of its power."""
    frequency, powers = window_powers(*sound)
    found = [(ratio_of_powers(frequency, powers, key_frequency(key) * 2 ** (cents / 1200)), cents) for cents in TUNING]
    levels, cents = max(found, key=lambda one: float(np.mean(one[0])))
    return Singing(levels, float(cents), power_above(*sound))


def render_notes(patch: str, key: int) -> list[Sound]:
    """A key of a patch, held, at each velocity; or the beginning of a patch without keys."""
    scene = engine.load(patch)
    scenes = (
        [scene] if scene.instrument is None else [scene_of_note(scene, key, v, SECONDS, SECONDS) for v in VELOCITIES]
    )
    return [(engine.render(one, SECONDS, RATE).audio, RATE) for one in scenes]


def note_row(name: str, notes: list[Singing]) -> list[str]:
    """A line of the table. notes: at each velocity, or one"""
    levels = [f"{note.levels.min():.0f}, {note.levels.mean():.0f}" for note in notes]
    cents = ", ".join(f"{note.cents:+.0f}" for note in notes)
    return [name, *levels, *[""] * (len(VELOCITIES) - len(notes)), cents, f"{max(n.fizz for n in notes):.0f}"]


def recorded_row() -> list[str] | None:
    """The line of a recorded sitar, if its sound font is there."""
    font = find_fonts().get(RECORDED)
    if font is None:
        return None
    with TemporaryDirectory() as folder:
        note = (RECORDED_KEY, RECORDED_LAYER, SECONDS)
        sound = play_font(font, [note], Path(folder), PROGRAM)(RECORDED_KEY, RECORDED_LAYER)
    assert sound is not None
    return note_row(f"recorded sitar, {key_name(RECORDED_KEY)}, {RECORDED}", [measure_singing(sound, RECORDED_KEY)])


def run(names: list[str]) -> int:
    """Measure some patches, all if none is named; print, and write the table of all."""
    if unknown := [name for name in names if name not in PATCHES]:
        print(f"bench recordings singing: {unknown[0]} is not one of {', '.join(PATCHES)}", file=sys.stderr)
        return 2
    rows = []
    for name in names or PATCHES:
        for key in PATCHES[name]:
            rows.append(
                note_row(f"{name}, {key_name(key)}", [measure_singing(s, key) for s in render_notes(name, key)])
            )
            print(*rows[-1], sep=" | ", file=sys.stderr)
    if (recorded := recorded_row()) is not None:
        rows.append(recorded)
        print(*recorded, sep=" | ", file=sys.stderr)
    if not names:
        publish("singing", HEADER, rows, "recordings")
    return 0
