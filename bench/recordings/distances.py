"""How far a note is from a recorded one: spectra by three measures, level, brightness, late decay."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.recordings.brightness import EDGE
from bench.recordings.keys import key_frequency
from bench.recordings.measure import CENTRES, FRAMES, WIDTHS, Frames, decibels, differences, root_mean_square
from bench.recordings.note import Note
from bench.recordings.octaves import late_ratios

WINDOWS = tuple(Frames(size / 44_100, size / 88_200) for size in (512, 2048, 8192))
ATTACK = Frames(0.05, 0.025, begin=-0.025, seconds=0.075)  # the sum of two windows is flat from the onset on
ATTACK_FLOOR_DB = 50.0
BRIGHTEST_KEY = 1000.0  # Hz: of a note above it, what lies over 2 kHz says nothing

NEIGHBOUR, ANOTHER_LAYER = "recorded neighbour, retuned", "recorded, another layer"


@dataclass(frozen=True)
class NoteResult:
    """How far one note of a source is from the recorded note of that key and layer."""

    source: str  # of natural variation, an instrument or a peer
    key: int
    layer: int
    bands: float  # dB, third octaves in frames of 50 ms
    windows: float  # dB, third octaves in windows of three lengths
    attack: float  # dB, third octaves of the first 50 ms
    level: float  # dB over the recorded one, with a gain that is the source's
    brightness: float  # dB, of the share above 2 kHz over the recorded one
    decays: np.ndarray  # logarithms of ratios of late decays [octaves]
    correlations: np.ndarray  # of left and right [octaves]
    recorded_correlations: np.ndarray  # [octaves]


def spectral_distance(note: Note, recorded: Note, frames: Frames = FRAMES, narrowest: float = 0.0) -> float:
    """RMS difference in bands at least so wide, Hz, at the best gain, where the recording is clear of its noise, dB."""
    wide = narrowest <= WIDTHS
    levels, its = (decibels(n.powers(frames)[:, wide] + 1e-30) for n in (note, recorded))
    off, counted = differences(levels, its, recorded.clear(frames)[:, wide])
    return root_mean_square(off[counted])


def windows_distance(note: Note, recorded: Note) -> float:
    """Mean over three lengths of windows of the RMS differences in the bands that each tells apart, dB."""
    return float(np.mean([spectral_distance(note, recorded, w, narrowest=1 / w.length) for w in WINDOWS]))


def attack_distance(note: Note, recorded: Note) -> float:
    """RMS difference of third octaves of the first 50 ms, dB, at the best gain, floor -50 dB."""
    levels, its = (decibels(n.powers(ATTACK).sum(axis=0, keepdims=True) + 1e-30) for n in (note, recorded))
    clear = np.asarray(recorded.clear(ATTACK).any(axis=0, keepdims=True))
    off, counted = differences(levels, its, clear, ATTACK_FLOOR_DB)
    return root_mean_square(off[counted])


def level_and_brightness(note: Note, recorded: Note) -> tuple[float, float]:
    """Level, and share above 2 kHz, over the recorded ones, dB; both over the cells in which the recording is clear.

    The share is not a number for a note above 1 kHz, nor where the recording has no clear cell above 2 kHz.
    """
    clear = recorded.clear()
    bright = clear & (CENTRES >= EDGE)
    mine, its = (
        decibels(np.array([n.powers()[clear].sum(), n.powers()[bright].sum()]) + 1e-30) for n in (note, recorded)
    )
    level, high = mine - its
    has_share = bright.any() and key_frequency(note.key) < BRIGHTEST_KEY
    return float(level), float(high - level) if has_share else math.nan


def compare_note(source: str, layer: int, note: Note, recorded: Note, with_decay: bool) -> NoteResult:
    """All distances of a note from the recorded one. with_decay: both are there for ten seconds"""
    level, brighter = level_and_brightness(note, recorded)
    clear = np.minimum(note.clear_frames, recorded.clear_frames) if with_decay else None
    return NoteResult(
        source,
        note.key,
        layer,
        spectral_distance(note, recorded),
        windows_distance(note, recorded),
        attack_distance(note, recorded),
        level,
        brighter,
        np.full(len(note.correlation), math.nan)
        if clear is None
        else late_ratios(note.octaves, recorded.octaves, clear, key_frequency(note.key)),
        note.correlation,
        recorded.correlation,
    )


def compare_layers(
    recorded: dict[int, Note], neighbour: dict[int, Note], sources: dict[str, dict[int, Note]], decay_layer: int
) -> Iterator[NoteResult]:
    """Compare a key at each layer recorded with natural variation, and with each source. All notes are by layer.

    neighbour: at the pitch of this key; decay_layer: at which all notes last for ten seconds
    """
    for layer, note in recorded.items():
        near = min((other for other in recorded if other != layer), key=lambda other: abs(other - layer), default=layer)
        natural = {NEIGHBOUR: neighbour, ANOTHER_LAYER: {layer: recorded[near]} if near != layer else {}}
        for source, notes in (sources | natural).items():
            if layer in notes:
                yield compare_note(source, layer, notes[layer], note, layer == decay_layer)
