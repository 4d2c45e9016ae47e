"""How far each key of the pitched instruments is from the tuning of its keyboard, at three velocities.

A string's pitch is that of its first partial, as the fit of f_n = n·f0·√(1 + B·n²) to all of its partials has it
(bench.recordings.partials): the first one by itself may be weak. Above 1 kHz, where strings have few partials, and of a
bar or tongue it is that of the first partial alone; of a bowed string it is the mean over eight turns of its vibrato.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import fftconvolve

import engine
from bench.publish.report import publish
from bench.recordings.partials import CYCLES, DETUNED, LONGEST, SHORTEST, START, read_partials
from engine.instrument.expansion import keys_of
from engine.instrument.formula import evaluate
from engine.instrument.key_names import note_name
from engine.instrument.listing import list_key
from engine.output_files import SILENT_PEAK
from engine.patch.note_scene import scene_of_note

RATE = 44_100
VELOCITIES = 30, 80, 120
MARGIN = 0.25  # s that a note lasts longer than what is read of it
STRUCK_SECONDS = 1.2  # from the onset, of a bar or tongue
BEGIN, TURN, TURNS = 0.664, 1 / 5.5, 8  # s: the violin has its vibrato from then on, and how long a turn is
PARTIALS = 6  # of a bowed string, of which the clearest tells the pitch
FEW_PARTIALS = 1000.0  # Hz, above which a string has few
NARROW = 6.0, 0.02  # periods and s that the window of a struck partial holds at least: others are left out
LAGS = 1, 8, 64, 512, 4096  # samples over which the turning of a partial is read: each needs the one before

ReadPitch = Callable[[np.ndarray, float, float], float]  # of audio [frames, channels], its rate, and about where, Hz


class Pitched(NamedTuple):
    """An instrument whose keys have a pitch."""

    patch: str
    read: ReadPitch
    seconds: Callable[[float], float]  # to render of a key with a frequency, Hz
    tuning: str = "= f"  # of a key, in the names of its patch


class Reading(NamedTuple):
    """A key at a velocity."""

    key: int
    velocity: int
    cents: float  # from its tuning; not a number if it has no pitch


def partial_motion(audio: np.ndarray, rate: float, frequency: float, periods: float) -> np.ndarray:
    """Complex amplitude [frames, channels] of what is near a frequency. periods: that a Hann window of it holds"""
    time = np.arange(len(audio))[:, None] / rate
    window = np.hanning(2 * round(periods / 2 * rate / frequency) + 3)[1:-1, None]
    return np.asarray(
        fftconvolve(audio * np.exp(-2j * np.pi * frequency * time), window / window.sum(), "same", axes=0)
    )


def first_partial(audio: np.ndarray, rate: float, near: float) -> float:
    """Frequency of the partial of a decaying sound that is near one, Hz; not a number of silence.

    The mean of how fast its phase turns, weighted by its power; first over short lags, which are not ambiguous, then
    over long ones, which noise and other partials disturb less.
    """
    periods = max(NARROW[0], NARROW[1] * near)
    motion = partial_motion(audio, rate, near, periods)
    edge = max(round(START * rate), math.ceil(periods / 2 * rate / near))
    motion = motion[edge : len(motion) - edge]
    if not np.abs(motion).max() > SILENT_PEAK:
        return math.nan
    time, shift = np.arange(len(motion))[:, None] / rate, 0.0
    for lag in LAGS:
        if lag < len(motion) // 3:
            slow = motion * np.exp(-2j * np.pi * shift * time)
            shift += float(np.angle(np.sum(slow[lag:] * slow[:-lag].conj()))) / (2 * math.pi * lag / rate)
    return near + shift


def string_pitch(audio: np.ndarray, rate: float, near: float) -> float:
    """Frequency of the first partial of a string, Hz; not a number of silence."""
    if near > FEW_PARTIALS:
        return first_partial(audio, rate, near)
    string = read_partials(audio, rate, near) if np.abs(audio).max() > SILENT_PEAK else None
    is_fit = string is not None and abs(1200 * math.log2(string.pitch / near)) < DETUNED[-1]  # not of other peaks
    return string.pitch if string and is_fit else first_partial(audio, rate, near)


def bowed_pitch(audio: np.ndarray, rate: float, near: float) -> float:
    """Pitch of a bowed note in the mean over its vibrato, Hz, by that of its first partials that is never weak."""
    inside = slice(round(BEGIN * rate), round((BEGIN + TURNS * TURN) * rate) + 1)
    motions = [partial_motion(audio, rate, n * near, 3.0 * n)[inside] for n in range(1, PARTIALS + 1)]
    least = [np.abs(motion).min(axis=0) for motion in motions]  # [partials][channels]
    number, channel = np.unravel_index(int(np.argmax(least)), np.shape(least))
    if not least[number][channel] > SILENT_PEAK:
        return math.nan
    phase = np.unwrap(np.angle(motions[number][:, channel]))
    turns = (phase[-1] - phase[0]) / (2 * np.pi) / ((phase.size - 1) / rate)
    return float(near + turns / (number + 1))


def string_seconds(frequency: float) -> float:
    """Seconds that the fit of a string's partials needs."""
    return min(max(CYCLES / frequency, SHORTEST), LONGEST) + START + MARGIN


def struck_seconds(_: float) -> float:
    """Seconds that the first partial of a bar or tongue needs."""
    return STRUCK_SECONDS


def bowed_seconds(_: float) -> float:
    """Seconds that the mean over a vibrato needs."""
    return BEGIN + TURNS * TURN + MARGIN


INSTRUMENTS = (
    Pitched("piano", string_pitch, string_seconds, "= f*cents(stretch)"),
    Pitched("guitar", string_pitch, string_seconds),
    Pitched("guitar_slide", string_pitch, string_seconds),
    Pitched("violin", bowed_pitch, bowed_seconds),
    Pitched("sitar", string_pitch, string_seconds),
    Pitched("tanpura_body", string_pitch, string_seconds, "= f*cents(-99.2*(key == 49))"),  # its C#3 is a second C3
    Pitched("kalimba_keys", first_partial, struck_seconds),
    Pitched("marimba_keys", first_partial, struck_seconds),
    Pitched("vibraphone", first_partial, struck_seconds),
)


def keys_of_instrument(of: Pitched) -> list[int]:
    """The keys of an instrument, as MIDI numbers."""
    return keys_of(document_of(of.patch)["keyboard"])


def document_of(patch: str) -> dict:
    """The document of a shipped instrument."""
    document = engine.load(patch).instrument
    assert document is not None
    return document


def read_key(of: Pitched, key: int, velocity: int) -> Reading:
    """Render a key alone, and read how far it is from its tuning."""
    scene = engine.load(of.patch)
    tuned = evaluate(of.tuning, list_key(document_of(of.patch), key, velocity)["values"])
    seconds = of.seconds(tuned)
    note = scene_of_note(scene, key, velocity, seconds + 1.0, seconds)
    pitch = of.read(engine.render(note, samplerate=RATE).audio, RATE, tuned)
    return Reading(key, velocity, 1200 * math.log2(pitch / tuned) if pitch > 0 else math.nan)


def row_of(of: Pitched, readings: list[Reading]) -> list[str]:
    """A row of the table."""
    row = [of.patch, f"{len({reading.key for reading in readings})}"]
    for velocity in VELOCITIES:
        heard = [r for r in readings if r.velocity == velocity and not math.isnan(r.cents)]
        if not heard:
            row += ["", ""]
            continue
        rms = math.sqrt(sum(r.cents**2 for r in heard) / len(heard))
        worst = max(heard, key=lambda r: abs(r.cents))
        row += [f"{rms:.1f}", f"{note_name(worst.key)} {worst.cents:+.1f}"]
    unread = [f"{note_name(r.key)} at {r.velocity}" for r in readings if math.isnan(r.cents)]
    return [*row, ", ".join(unread) or "none"]


def run() -> None:
    """Measure and publish."""
    rows = []
    for of in INSTRUMENTS:
        readings = [read_key(of, key, v) for key in keys_of_instrument(of) for v in VELOCITIES]
        rows.append(row_of(of, readings))
        print(*rows[-1], sep=" | ", flush=True)
    head = [text for v in VELOCITIES for text in (f"MIDI {v}: rms, cents", "worst, cents")]
    publish("pitch", ["instrument", "keys", *head, "without a pitch"], rows)
