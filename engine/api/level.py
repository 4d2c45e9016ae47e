"""The level of a patch: the gain at which the loudest of its single notes peaks at half of full scale."""

import math
from dataclasses import dataclass

import numpy as np

from engine.api.rendering import render
from engine.argument_checks import checked_integer
from engine.instrument.key_names import note_name
from engine.instrument.key_sequencer import FULL_VELOCITY
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import HEADROOM, Player
from engine.live.shared_memory import Gauge
from engine.output_files import SILENT_PEAK
from engine.patch.frames import frame_count
from engine.patch.scene import Scene, check_scene

NOTE_SECONDS = 0.8  # of a key: what is bowed or blown is loudest some time after its attack
DAMP_SECONDS = 0.1  # between two keys …
DAMP_RATE = 200.0  # … in which all bodies decay by 170 dB, 1/s


@dataclass(frozen=True)
class MeasuredLevel:
    """The level of a patch, measured.

    level:   dB, the gain on SI units at which the peak is half of full scale, -6 dBFS
    peak:    of the loudest note, SI units
    loudest: the key of an instrument that is the loudest, such as C4; "" for other patches
    """

    level: float
    peak: float
    loudest: str = ""


def measure_level(scene: Scene, samplerate: int = 44_100, kernel: str | None = None) -> MeasuredLevel | None:
    """Measure the level of a patch: of an instrument, each key alone at velocity 127; of another patch, all that it
    plays by itself. None if it is silent.

    samplerate: Hz
    kernel:     general or special (engine.runtime.kernel_choice)

    >>> import fdh
    >>> from engine.api.level import measure_level
    >>> round(measure_level(fdh.load("bouncing_ball")).level)
    -12

    Raises TypeError for another argument, BuildError if the scene cannot be built.
    """
    check_scene(scene)
    samplerate = checked_integer("samplerate", samplerate)
    if scene.instrument is None:
        audio = render(scene, samplerate=samplerate, kernel=kernel).audio
        return _level_of(float(abs(audio).max(initial=0.0)))
    peaks = measure_keys(scene, samplerate, kernel)
    key = max(peaks, key=lambda key: peaks[key])
    return _level_of(peaks[key], note_name(key))


def measure_keys(scene: Scene, samplerate: int = 44_100, kernel: str | None = None) -> dict[int, float]:
    """Measure the peak of each key of an instrument at velocity 127, in SI units. Raises ValueError if it is none."""
    player = Player(live_scene(scene), samplerate, math.inf, waiting=True, kernel=kernel)
    allocator, peaks = KeyAllocator(player), dict[int, float]()
    _play(player, DAMP_SECONDS)  # while it fades in
    for key in allocator.keys:
        allocator.play(Note(0.0, "on", key, FULL_VELOCITY))
        peaks[key] = _play(player, NOTE_SECONDS)
        allocator.play(Note(0.0, "off", key, 0))
        player.damp(None, DAMP_RATE, DAMP_SECONDS)
        _play(player, DAMP_SECONDS)
    return peaks


def _play(player: Player, seconds: float) -> float:
    """Play on for a while. Returns the peak, which no limiter has reduced."""
    player.gauges[Gauge.PEAK] = 0.0
    player.render_into(np.zeros((frame_count(seconds, player.samplerate), player.channels), np.float32))
    return float(player.gauges[Gauge.PEAK])


def _level_of(peak: float, loudest: str = "") -> MeasuredLevel | None:
    if peak <= SILENT_PEAK:
        return None
    return MeasuredLevel(20.0 * math.log10(HEADROOM / peak), peak, loudest)
