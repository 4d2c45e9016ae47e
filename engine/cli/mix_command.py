"""The command `render` with `--play`: each part of a MIDI file is played by a patch, and all are mixed to one sound."""

import argparse
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.cli.arguments import patch_file
from engine.cli.messages import (
    CommandError,
    describe_leading_silence,
    describe_mended_file,
    print_messages,
    print_result,
)
from engine.cli.notes import (
    PARTS_REMEDY,
    PlayedNotes,
    levels_of_file,
    note_errors_explained,
    play_notes,
)
from engine.cli.option_checks import MIDI_CHANNELS, excerpt_of, samplerate_of
from engine.cli.progress import progress_feedback
from engine.cli.stems import read_markers, write_stems
from engine.cli.tuning_options import read_tuned_patch
from engine.faults import Fault
from engine.output_files import SILENT_PEAK

if TYPE_CHECKING:
    import numpy as np

    from engine.live.channel_levels import ChannelLevels
    from engine.live.midi_parts import Excerpt, Part, PartKey
    from engine.patch.scene import Scene

MAX_LEVEL = 200.0  # dB, either way
PLAY_HELP = "give CHANNEL=PATCH, such as 2=guitar,10=snare; t3=PATCH or NAME=PATCH for a track"


@dataclass
class MixedPatch:
    """A patch and the parts that it plays."""

    patch: str
    scene: "Scene"
    level: float = 0.0  # dB
    parts: "set[PartKey]" = field(default_factory=set)

    @property
    def name(self) -> str:
        """The name of the patch."""
        return Path(self.patch).stem

    @property
    def of_patch(self) -> tuple[str, float]:
        """The patch and its level, which are those of all its parts."""
        return self.patch, self.level


@dataclass(frozen=True)
class Assignment:
    """A channel or track of a MIDI file, and the patch that plays it."""

    chosen: str  # number of a channel; t and the number of a track; or the name of one
    mixed: MixedPatch

    def has(self, part: "Part") -> bool:
        """True if a part is of that channel or track."""
        if self.chosen.isdecimal():
            return part.channel == int(self.chosen)
        track = self.chosen[1:]
        return part.is_on_track(track if self.chosen[:1] == "t" and track.isdecimal() else self.chosen)


@dataclass(frozen=True, eq=False)
class MixedSound:
    """The sound of a patch in a mix."""

    mixed: MixedPatch
    notes: PlayedNotes
    peak: float  # SI units


def read_assignments(args: argparse.Namespace) -> tuple[list[Assignment], list[Fault]]:
    """The value of --play, with the patches that it names; and all faults of both."""
    assignments, faults = list[Assignment](), list[Fault]()
    scenes: dict[str, Scene | None] = {}
    for item in [] if args.play is None else args.play.split(","):
        chosen, equals, patch = (text.strip() for text in item.partition("="))
        patch, level = split_level(patch)
        if not (chosen and equals and patch):
            faults.append(Fault("--play", f'"{item}" does not name a channel and a patch; {PLAY_HELP}'))
        elif chosen.isdecimal() and not 1 <= int(chosen) <= MIDI_CHANNELS:
            faults.append(
                Fault("--play", f"{chosen} is not a MIDI channel; give 1 to {MIDI_CHANNELS}, or t{chosen} for a track")
            )
        elif not abs(level) <= MAX_LEVEL:
            faults.append(Fault("--play", f"{level:g} dB is out of range; give -{MAX_LEVEL:g} to {MAX_LEVEL:g} dB"))
        else:
            path = patch_file(patch)
            if path not in scenes:
                scenes[path], patch_faults = read_tuned_patch(path, args)
                faults += patch_faults
            if (scene := scenes[path]) is not None:
                assignments.append(Assignment(chosen, MixedPatch(path, scene, level)))
    return assignments, faults


def split_level(text: str) -> tuple[str, float]:
    """A patch and its level in dB, of PATCH@DB; the level is 0 if there is none."""
    patch, _, level = text.rpartition("@")
    try:
        return (patch, float(level)) if patch else (text, 0.0)
    except ValueError:
        return text, 0.0


def mix_command(scene: "Scene", assignments: list[Assignment], args: argparse.Namespace) -> int:
    """Render the parts of a MIDI file by several patches, and write their mix; returns the exit code."""
    from engine.cli.rendering import about_patch, describe_interruption, prepare_sound, write_prepared
    from engine.report.console import print_mix_summary

    with note_errors_explained():
        patches, excerpt = assign_parts(scene, assignments, args)
        patches = [one for mixed in patches for one in divide_by_level(mixed, excerpt, args)]
        if args.stems is not None:
            patches = [replace(mixed, parts={part}) for mixed in patches for part in sorted(mixed.parts)]
        played, left_out = play_patches(patches, excerpt, args)
        if not played:
            raise CommandError("no patch has a note to play; give other channels, tracks or patches", 2)
        rate = samplerate_of(args)
        factors = mix_factors(played, args)
        sounds = sounds_in_mix(played, factors, levels_of_mix(played), rate)
        kernel, length = played[0].notes.readings.kernel, len(sounds[0]) / rate
        tempo, markers = read_markers(Path(args.midi), excerpt, length)
        about = replace(about_patch(scene, args, kernel), tempo=tempo, markers=markers)
        mix, stats = prepare_sound(args, sum(sounds[1:], sounds[0]), about)
        write_prepared(mix)
        if args.stems is not None:
            names = [name_of_part(one, args) for one in played]
            stats["stems"] = [str(path) for path in write_stems(Path(args.stems), names, sounds, mix)]
    is_interrupted = bool(left_out) or played[-1].notes.is_interrupted
    if is_interrupted:
        last, names = played[-1], [mixed.name for mixed in left_out]
        rendered = last.notes.audio, samplerate_of(args), last.notes.seconds
        print_messages([describe_interruption(*rendered, names, last.mixed.name)])
    reasons = [f"{one.mixed.name}: {reason}" for one in played for reason in one.notes.reasons]
    stats |= {"trusted": not reasons, "reasons": reasons, "interrupted": is_interrupted}
    gains = [stats["gain_db"] + 20 * math.log10(factor) for factor in factors]
    stats["parts"] = [describe_part(one, gain) for one, gain in zip(played, gains, strict=True)]
    print_result(args.json, stats, lambda: print_mix_summary(stats))
    return 130 if is_interrupted else 0


def play_patches(
    patches: list[MixedPatch], excerpt: "Excerpt", args: argparse.Namespace
) -> tuple[list[MixedSound], list[MixedPatch]]:
    """Render what each patch plays, up to Ctrl-C. Returns their sounds, of which Ctrl-C makes the last one shorter; and
    the patches of which it left nothing. Raises KeyboardInterrupt if that is all of them."""
    played = list[MixedSound]()
    for number, mixed in enumerate(patches):
        try:
            sound = play_parts(mixed, excerpt, args)
        except KeyboardInterrupt:
            if not played:
                raise
            return played, patches[number:]
        if sound is not None:
            played.append(sound)
            if sound.notes.is_interrupted:
                return played, patches[number + 1 :]
    return played, []


def describe_part(sound: MixedSound, gain: float) -> dict[str, Any]:
    """A patch in a mix, as `--json` prints it. gain: in the mix, dB on SI units"""
    readings = sound.notes.readings
    return {
        "patch": sound.mixed.patch,
        "gain_db": gain,
        "real_time_factor": readings.real_time_factor,
        "kernel": readings.kernel,
        "table_digest": readings.table_digest,
        "energy_error": sound.notes.energy_error,
        "parts": [{"track": track, "channel": channel} for track, channel in sorted(sound.mixed.parts)],
    }


def assign_parts(
    scene: "Scene", assignments: list[Assignment], args: argparse.Namespace
) -> "tuple[list[MixedPatch], Excerpt]":
    """The patches that play, each with its parts; and the excerpt of the file that all of them play. What no option
    gives to another patch is for PATCH. Raises MidiError."""
    from engine.instrument.tables import drum_keys
    from engine.live.midi_drivers import MidiError
    from engine.live.midi_files import read_parts
    from engine.live.midi_parts import list_parts

    excerpt = excerpt_of(args)
    song = read_parts(Path(args.midi), scene.midi, excerpt.tempo)
    parts = song.parts
    print_messages(describe_mended_file(args.midi, song.mended))
    patches = {(args.patch, 0.0): MixedPatch(args.patch, scene)}
    for assignment in assignments:
        chosen = {part.key for part in parts if assignment.has(part)}
        if not chosen:
            raise MidiError(f"{args.midi} has no notes on {assignment.chosen}; its parts are {list_parts(parts)}")
        mixed = assignment.mixed
        patches.setdefault((mixed.patch, mixed.level), mixed).parts.update(chosen)
    given = set().union(*(mixed.parts for mixed in patches.values()))
    takes_drums = drum_keys(scene.instrument) is not None
    if excerpt.channels or excerpt.tracks:
        excerpt.choose(parts, takes_drums)  # what is chosen must be in the file, whoever plays it
    others = [part for part in parts if part.key not in given]
    try:
        rest, left_out = excerpt.choose(others, takes_drums)
    except MidiError:  # all that is chosen was given to others
        rest, left_out = [], []
    patches[args.patch, 0.0].parts.update(part.key for part in rest)
    if left_out:
        count = sum(part.notes for part in left_out)
        print_messages([f"{args.midi}: {count} notes were left out: {list_parts(left_out)}; {PARTS_REMEDY}"])
    played = set().union(*(mixed.parts for mixed in patches.values()))
    begin = 0.0 if args.keep_start else min(part.begin for part in parts if part.key in played)
    print_messages(describe_leading_silence(args.midi, begin))
    return [mixed for mixed in patches.values() if mixed.parts], replace(excerpt, begin=begin)


def divide_by_level(mixed: MixedPatch, excerpt: "Excerpt", args: argparse.Namespace) -> list[MixedPatch]:
    """Divide what a patch plays by channels if these have different volumes or pans, which one sound cannot follow.
    Raises MidiError."""
    from engine.instrument.tables import drum_keys
    from engine.live.midi_files import read_notes
    from engine.live.midi_notes import NothingToPlay

    scene, parts = mixed.scene, replace(excerpt, parts=frozenset(mixed.parts))
    try:
        file = read_notes(Path(args.midi), scene.midi, excerpt=parts, drums=drum_keys(scene.instrument))
    except NothingToPlay:  # which is said when it is to be played
        return [mixed]
    if not levels_of_file(file).remark:
        return [mixed]
    channels = sorted({channel for _, channel in mixed.parts})
    return [replace(mixed, parts={part for part in mixed.parts if part[1] == channel}) for channel in channels]


def play_parts(mixed: MixedPatch, excerpt: "Excerpt", args: argparse.Namespace) -> MixedSound | None:
    """Render what a patch plays, and print what of it is not played; None if that is all. Raises MidiError, BuildError,
    MemoryError."""
    from engine.live.midi_drivers import MidiError
    from engine.live.midi_notes import NothingToPlay

    try:
        with progress_feedback(f"rendering {mixed.name}") as progress:
            parts = replace(excerpt, parts=frozenset(mixed.parts))
            notes = play_notes(mixed.scene, parts, args, progress, channels=2)
    except NothingToPlay as error:
        print_messages([f"{mixed.name}: {error}"])
        return None
    except MidiError as error:
        raise MidiError(f"{mixed.name}: {error}") from None
    print_messages(f"{mixed.name}: {line}" for line in notes.remarks)
    return MixedSound(mixed, notes, float(abs(notes.audio).max()))


def mix_factors(played: list[MixedSound], args: argparse.Namespace) -> list[float]:
    """The factors of sounds in a mix. Unless a gain is given, all patches are brought to the same peak before their
    levels apply, as SI units of different pickups do not compare; what one patch plays in parts keeps its balance."""
    peaks = dict[tuple[str, float], float]()
    for one in played:
        peaks[one.mixed.of_patch] = max(peaks.get(one.mixed.of_patch, 0.0), one.peak)
    factors = list[float]()
    for one in played:
        level = one.mixed.level + (0.0 if args.level is None else one.mixed.scene.level or 0.0)
        peak = peaks[one.mixed.of_patch] if args.gain is None else 0.0
        factors.append(math.pow(10.0, level / 20.0) / (peak if peak > SILENT_PEAK else 1.0))
    return factors


def levels_of_mix(played: list[MixedSound]) -> "list[ChannelLevels]":
    """The volumes and pans of the sounds of a mix. A channel without a volume has that of General MIDI if another one
    has a volume."""
    from engine.live.channel_levels import DEFAULT_VOLUME, FULL, has_volume

    default = DEFAULT_VOLUME if any(has_volume(one.notes.file.levels) for one in played) else FULL
    return [levels_of_file(one.notes.file, default) for one in played]


def sounds_in_mix(
    played: list[MixedSound], factors: list[float], levels: "list[ChannelLevels]", samplerate: int
) -> "list[np.ndarray]":
    """All sounds at their levels, the shorter ones followed by silence, each [frames, channels]; their sum is the mix.
    A mono sound is on the first two channels; there are two at least if one is panned."""
    import numpy as np

    channels = max(*(one.notes.audio.shape[1] for one in played), 1 + any(each.pans for each in levels))
    sounds = list[np.ndarray]()
    for one, factor, each in zip(played, factors, levels, strict=True):
        audio = one.notes.audio * factor
        if audio.shape[1] == 1:
            audio = np.repeat(audio, min(channels, 2), axis=1)
        sounds.append(np.zeros((max(len(other.notes.audio) for other in played), channels)))
        sounds[-1][: len(audio), : audio.shape[1]] = each.apply(audio, samplerate)
    return sounds


def name_of_part(sound: MixedSound, args: argparse.Namespace) -> str:
    """The name of a part of a MIDI file: that of its track, or its channel, and that of the patch that plays it."""
    from engine.live.midi_files import read_parts

    parts = read_parts(Path(args.midi), sound.mixed.scene.midi).parts
    names = [part.name or f"channel {part.channel}" for part in parts if part.key in sound.mixed.parts]
    track = names[0] if names and names[0].casefold() != sound.mixed.name.casefold() else ""
    return f"{track} {sound.mixed.name}".strip()
