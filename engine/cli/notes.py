"""Notes of a MIDI file as sound: played by the keys of an instrument, or by the voices of another patch."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from engine.cli.messages import (
    CHOOSE_PARTS,
    CommandError,
    describe_leftover,
    describe_midi_file,
    describe_unknown_drums,
    memory_errors_explained,
)
from engine.cli.option_checks import excerpt_of, samplerate_of, voice_count
from engine.cli.progress import Progress
from engine.cli.rendering import render_scene

if TYPE_CHECKING:
    import numpy as np

    from engine.live.meter import MeterReading
    from engine.live.midi_files import MidiNotes
    from engine.live.midi_parts import Excerpt
    from engine.offline.statistics import RenderStatistics
    from engine.patch.scene import Scene

PARTS_REMEDY = f"{CHOOSE_PARTS}, or give channels to other patches with --play"


@dataclass(frozen=True, eq=False)
class PlayedNotes:
    """The notes of a MIDI file, or of some of its parts, as a patch plays them."""

    audio: "np.ndarray"  # SI units, [frames, channels]
    file: "MidiNotes"
    readings: "RenderStatistics | MeterReading"  # of an instrument, or of voices
    energy_error: float  # relative to the largest energy held
    reasons: list[str]  # not to trust it
    remarks: list[str]  # on what was not played
    played: dict[str, str]  # the notes that voices played, by the body that sounds


@contextmanager
def note_errors_explained() -> Iterator[None]:
    """Within it, a MidiError and a MemoryError become CommandErrors."""
    from engine.live.midi_notes import MidiError

    try:
        with memory_errors_explained("give fewer --seconds or --voices"):
            yield
    except MidiError as error:
        raise CommandError(error, 2) from error


def add_score(scene: "Scene", args: argparse.Namespace, remedy: str = CHOOSE_PARTS) -> "tuple[Scene, list[str]]":
    """Return an instrument with the score of a MIDI file, and lines on what of the file it does not play. Raises
    MidiError. remedy: how other parts would be played"""
    from engine.live.instrument_notes import scene_of_file

    played = scene_of_file(scene, Path(args.midi), excerpt_of(args))
    lines = describe_midi_file(args.midi, played.file, remedy)
    return played.scene, lines + describe_leftover(played.refused, played.ignored)


def play_notes(scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress) -> PlayedNotes:
    """Render the notes of a MIDI file. excerpt: which of them. Raises MidiError, BuildError, MemoryError."""
    return (_play_on_keyboard if scene.instrument else _play_on_voices)(scene, excerpt, args, progress)


def _play_on_keyboard(scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress) -> PlayedNotes:
    from engine.live.instrument_notes import scene_of_file

    score = scene_of_file(scene, Path(args.midi), excerpt)
    rendering = render_scene(score.scene, args, progress)
    stats = rendering.stats
    remarks = describe_unknown_drums(score.file) + describe_leftover(score.refused, score.ignored) + stats.warnings
    return PlayedNotes(rendering.audio, score.file, stats, stats.energy.error_max, stats.reasons, remarks, {})


def _play_on_voices(scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress) -> PlayedNotes:
    from engine.assembly.limits import build_modal_bodies
    from engine.live.midi import render_notes
    from engine.offline.trust import explain_doubts

    rate = samplerate_of(args)
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**args.accuracy)})
    build_modal_bodies(scene, rate, scene.accuracy.scheme)
    audio, player, voices, file = render_notes(
        scene, args.midi, rate, args.seconds, voice_count(args), progress, excerpt
    )
    reading = player.meter()
    reasons = explain_doubts(reading.newton, reading.energy_error, not reading.not_finite)
    remarks = describe_leftover([], voices.ignored, voices.stolen, voices.refused)
    return PlayedNotes(audio, file, reading, reading.energy_error, reasons, remarks, voices.played_notes())
