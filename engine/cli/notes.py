"""Notes of a MIDI file as sound: played by the keys of an instrument, or by the voices of another patch."""

import argparse
from collections.abc import Callable, Iterator
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
from engine.cli.rendering import keep_interrupted, render_scene

if TYPE_CHECKING:
    import numpy as np

    from engine.live.channel_levels import ChannelLevels
    from engine.live.meter import MeterReading
    from engine.live.midi_files import MidiNotes
    from engine.live.midi_parts import Excerpt
    from engine.offline.statistics import RenderStatistics
    from engine.patch.scene import Scene

PARTS_REMEDY = f"{CHOOSE_PARTS}, or give channels to other patches with --play"


@dataclass(frozen=True, eq=False)
class PlayedNotes:
    """The notes of a MIDI file, or of some of its parts, as a patch plays them; or as much as Ctrl-C left."""

    audio: "np.ndarray"  # SI units, [frames, channels]
    file: "MidiNotes"
    readings: "RenderStatistics | MeterReading"  # of an instrument, or of voices
    energy_error: float  # relative to the largest energy held
    reasons: list[str]  # not to trust it
    remarks: list[str]  # on what was not played, and the warnings
    warnings: list[str]
    played: dict[str, str]  # the notes that voices played, by the body that sounds
    seconds: float  # that were to be rendered
    is_interrupted: bool


@contextmanager
def note_errors_explained() -> Iterator[None]:
    """Within it, a MidiError and a MemoryError become CommandErrors."""
    from engine.live.midi_drivers import MidiError

    try:
        with memory_errors_explained("give fewer --seconds or --voices"):
            yield
    except MidiError as error:
        raise CommandError(error, 2) from error


def add_score(scene: "Scene", args: argparse.Namespace) -> "tuple[Scene, list[str]]":
    """Return an instrument with the score of a MIDI file, and lines on what of the file it does not play. Raises
    MidiError."""
    from engine.live.instrument_notes import scene_of_file

    played = scene_of_file(scene, Path(args.midi), excerpt_of(args))
    levels = levels_of_file(played.file)
    lines = describe_midi_file(args.midi, played.file, CHOOSE_PARTS) + describe_levels(args.midi, levels)
    ignored = without_levels(played.ignored, levels, scene.channels)
    return played.scene, lines + describe_leftover(played.refused, ignored)


def add_score_with_levels(
    scene: "Scene", args: argparse.Namespace
) -> "tuple[Scene, Callable[[np.ndarray], np.ndarray], list[str]]":
    """Return an instrument with the score of a MIDI file, what brings its sound to the volumes of the file, and lines
    on what of the file it does not play. Raises MidiError."""
    from engine.live.instrument_notes import scene_of_file

    played = scene_of_file(scene, Path(args.midi), excerpt_of(args))
    levels = levels_of_file(played.file)
    lines = describe_midi_file(args.midi, played.file, PARTS_REMEDY) + describe_levels(args.midi, levels)
    ignored = without_levels(played.ignored, levels, scene.channels)
    rate = samplerate_of(args)
    return played.scene, lambda audio: levels.apply(audio, rate), lines + describe_leftover(played.refused, ignored)


def levels_of_file(file: "MidiNotes", default_volume: int | None = None) -> "ChannelLevels":
    """The volumes and pans of the parts of a file that are played.

    default_volume: of channels that have none, if there are other sounds in the mix; None if there are not
    """
    from engine.live.channel_levels import DEFAULT_VOLUME, FULL, has_volume, levels_of

    default = (DEFAULT_VOLUME if has_volume(file.levels) else FULL) if default_volume is None else default_volume
    return levels_of(list(file.levels), [part.channel for part in file.parts], default)


def describe_levels(path: str, levels: "ChannelLevels") -> list[str]:
    """Describe what of the volumes of a MIDI file is not heard."""
    return [f"{path}: {levels.remark}"] if levels.remark else []


def without_levels(ignored: dict[str, int], levels: "ChannelLevels", channels: int) -> dict[str, int]:
    """Messages that were ignored, without those that a sound of so many channels follows."""
    from engine.live.channel_levels import PAN

    followed = {f"controller {control}" for control in levels.controls if control != PAN or channels > 1}
    return {kind: count for kind, count in ignored.items() if kind not in followed}


def play_notes(
    scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress, channels: int | None = None
) -> PlayedNotes:
    """Render the notes of a MIDI file, before its volumes are applied. Raises MidiError, BuildError, MemoryError; and
    KeyboardInterrupt at Ctrl-C, if nothing is rendered by then.

    excerpt:  which of them
    channels: of the sound file; those of the scene if None
    """
    play = _play_on_keyboard if scene.has_keys else _play_on_voices
    return play(scene, excerpt, args, progress, scene.channels if channels is None else channels)


def _play_on_keyboard(
    scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress, channels: int
) -> PlayedNotes:
    from engine.live.instrument_notes import scene_of_file

    score = scene_of_file(scene, Path(args.midi), excerpt)
    rendering, is_interrupted = keep_interrupted(lambda: render_scene(score.scene, args, progress))
    stats = rendering.stats
    leftover = describe_leftover(score.refused, without_levels(score.ignored, levels_of_file(score.file), channels))
    remarks = describe_unknown_drums(score.file) + leftover + stats.warnings
    error, doubts = stats.energy.error_max, stats.reasons
    seconds = score.scene.seconds if args.seconds is None else args.seconds
    return PlayedNotes(
        rendering.audio, score.file, stats, error, doubts, remarks, stats.warnings, {}, seconds, is_interrupted
    )


def _play_on_voices(
    scene: "Scene", excerpt: "Excerpt", args: argparse.Namespace, progress: Progress, channels: int
) -> PlayedNotes:
    from engine.assembly.limits import build_modal_bodies
    from engine.live.midi import render_notes
    from engine.offline.trust import explain_doubts

    rate = samplerate_of(args)
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**args.accuracy)})
    build_modal_bodies(scene, rate, scene.accuracy.scheme)
    count = voice_count(args)
    rendered, is_interrupted = keep_interrupted(lambda: render_notes(scene, args.midi, rate, excerpt, count, progress))
    audio, player, voices, file, warnings, seconds = rendered
    reading = player.meter()
    reasons = explain_doubts(reading.newton, reading.energy_error, not reading.not_finite)
    ignored = without_levels(voices.ignored, levels_of_file(file), channels)
    remarks = describe_leftover([], ignored, voices.stolen, voices.refused) + warnings
    played = voices.played_notes()
    return PlayedNotes(
        audio, file, reading, reading.energy_error, reasons, remarks, warnings, played, seconds, is_interrupted
    )
