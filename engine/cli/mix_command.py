"""The command `render` with `--play`: each part of a MIDI file is played by a patch, and all are mixed to one sound."""

import argparse
import json
import math
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.cli.arguments import patch_file
from engine.cli.messages import (
    describe_leading_silence,
    describe_leftover,
    describe_unknown_drums,
    print_error,
    read_patch,
)
from engine.cli.option_checks import (
    MIDI_CHANNELS,
    NumericOptions,
    accuracy_options,
    excerpt_of,
    samplerate_of,
    sound_path,
    voice_count,
)
from engine.cli.progress import progress_feedback
from engine.faults import Fault
from engine.output_files import (
    SILENT_PEAK,
    apply_gain,
    count_clipped,
    describe_lowered_gain,
    error_reason,
    save_audio,
)
from engine.wording import json_safe

if TYPE_CHECKING:
    import numpy as np

    from engine.live.midi_parts import Excerpt, Part, PartKey
    from engine.patch.scene import Scene

PARTS_REMEDY = "choose parts with --channels or --tracks, or give channels to other patches with --play"
MAX_LEVEL = 200.0  # dB, either way
PLAY_HELP = "give CHANNEL=PATCH, such as 2=guitar,10=snare; t3=PATCH or NAME=PATCH for a track"


@dataclass(frozen=True)
class Assignment:
    """A channel or track of a MIDI file, and the patch that plays it."""

    chosen: str  # number of a channel; t and the number of a track; or the name of one
    patch: str
    level: float  # dB
    scene: "Scene"

    def has(self, part: "Part") -> bool:
        """True if a part is of that channel or track."""
        if self.chosen.isdecimal():
            return part.channel == int(self.chosen)
        track = self.chosen[1:]
        return part.is_on_track(track if self.chosen[:1] == "t" and track.isdecimal() else self.chosen)


@dataclass
class MixedPatch:
    """A patch and the parts that it plays."""

    patch: str
    scene: "Scene"
    level: float  # dB
    parts: "set[PartKey]" = field(default_factory=set)


@dataclass(frozen=True)
class MixedSound:
    """The sound of a patch in a mix."""

    mixed: MixedPatch
    audio: "np.ndarray"  # SI units, [frames, channels]
    real_time_factor: float
    kernel: str
    energy_error: float
    reasons: list[str]  # not to trust it
    remarks: list[str]

    @property
    def name(self) -> str:
        """That of the patch."""
        return Path(self.mixed.patch).stem


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
                scenes[path], patch_faults = read_patch(path)
                faults += patch_faults
            if (scene := scenes[path]) is not None:
                assignments.append(Assignment(chosen, path, level, scene))
    return assignments, faults


def split_level(text: str) -> tuple[str, float]:
    """A patch and its level in dB, of PATCH@DB; the level is 0 if there is none."""
    patch, _, level = text.rpartition("@")
    try:
        return (patch, float(level)) if patch else (text, 0.0)
    except ValueError:
        return text, 0.0


def mix_command(
    scene: "Scene", assignments: list[Assignment], numbers: NumericOptions, args: argparse.Namespace
) -> int:
    """Render the parts of a MIDI file by several patches, and write their mix; returns the exit code."""
    from engine.live.midi_notes import MidiError

    rate, output = samplerate_of(numbers), sound_path(args)
    try:
        patches, excerpt = assign_parts(scene, assignments, numbers, args)
        sounds = [play_parts(mixed, excerpt, numbers, args) for mixed in patches]
        if not (played := [sound for sound in sounds if sound is not None]):
            raise MidiError("no patch has a note to play; give other channels, tracks or patches")
        mix, factors = mix_parts(played, is_balanced=numbers["gain"] is None)
        mix, gain = apply_gain(mix, float(abs(mix).max()), numbers["gain"], args.subtype)
        save_audio(output, mix, rate, args.subtype)
        cut = count_clipped(output, mix, gain, args.subtype)
    except MidiError as error:
        print_error(error)
        return 2
    except MemoryError:
        print_error("there is not enough memory for so many samples; give fewer --seconds or --voices")
        return 1
    except (OSError, RuntimeError) as error:
        print_error(f"cannot write {output} ({error_reason(error)})")
        return 1
    for line in [*([f"{output}: {cut}"] if cut else []), *describe_lowered_gain(output, gain, numbers["gain"])]:
        print(line, file=sys.stderr)
    reasons = [f"{part.name}: {reason}" for part in played for reason in part.reasons]
    stats = {"patch": args.patch, "output": str(output), "seconds": len(mix) / rate, "samplerate": rate}
    stats |= {"channels": mix.shape[1], "peak": float(abs(mix).max()), "gain_db": gain}
    stats |= {"clipped": cut.count if cut else 0, "trusted": not reasons, "reasons": reasons}
    stats["parts"] = [
        describe_part(part, gain + 20 * math.log10(factor)) for part, factor in zip(played, factors, strict=True)
    ]
    if args.json:
        print(json.dumps(json_safe(stats)))
    else:
        from engine.report.console import print_mix_summary

        print_mix_summary(stats)
    return 0


def describe_part(part: MixedSound, gain: float) -> dict[str, Any]:
    """A patch in a mix, as `--json` prints it. gain: in the mix, dB on SI units"""
    described = {"patch": part.mixed.patch, "gain_db": gain, "real_time_factor": part.real_time_factor}
    described |= {"kernel": part.kernel, "energy_error": part.energy_error}
    return described | {"parts": [{"track": track, "channel": channel} for track, channel in sorted(part.mixed.parts)]}


def assign_parts(
    scene: "Scene", assignments: list[Assignment], numbers: NumericOptions, args: argparse.Namespace
) -> "tuple[list[MixedPatch], Excerpt]":
    """The patches that play, each with its parts; and the excerpt of the file that all of them play. What no option
    gives to another patch is for PATCH. Raises MidiError."""
    from engine.instrument.tables import drum_keys
    from engine.live.midi_files import read_parts
    from engine.live.midi_notes import MidiError
    from engine.live.midi_parts import list_parts

    _, parts = read_parts(Path(args.midi), scene.midi)
    excerpt = excerpt_of(args, numbers["seconds"])
    patches = {(args.patch, 0.0): MixedPatch(args.patch, scene, 0.0)}
    for assignment in assignments:
        chosen = {part.key for part in parts if assignment.has(part)}
        if not chosen:
            raise MidiError(f"{args.midi} has no notes on {assignment.chosen}; its parts are {list_parts(parts)}")
        mixed = MixedPatch(assignment.patch, assignment.scene, assignment.level)
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
        print(f"{args.midi}: {count} notes were left out: {list_parts(left_out)}; {PARTS_REMEDY}", file=sys.stderr)
    played = set().union(*(mixed.parts for mixed in patches.values()))
    begin = min(part.begin for part in parts if part.key in played)
    for line in describe_leading_silence(args.midi, begin):
        print(line, file=sys.stderr)
    return [mixed for mixed in patches.values() if mixed.parts], replace(excerpt, begin=begin)


def play_parts(
    mixed: MixedPatch, excerpt: "Excerpt", numbers: NumericOptions, args: argparse.Namespace
) -> MixedSound | None:
    """Render what a patch plays, and print what of it is not played; None if that is all. Raises MidiError, BuildError,
    MemoryError."""
    from engine.live.midi_notes import MidiError, NothingToPlay

    excerpt = replace(excerpt, parts=frozenset(mixed.parts))
    try:
        with progress_feedback(f"rendering {Path(mixed.patch).stem}") as progress:
            render = play_on_keyboard if mixed.scene.instrument else play_on_voices
            played = render(mixed, excerpt, numbers, args, progress)
    except NothingToPlay as error:
        print(f"{Path(mixed.patch).stem}: {error}", file=sys.stderr)
        return None
    except MidiError as error:
        raise MidiError(f"{Path(mixed.patch).stem}: {error}") from None
    for line in played.remarks:
        print(f"{played.name}: {line}", file=sys.stderr)
    return played


def play_on_keyboard(
    mixed: MixedPatch, excerpt: "Excerpt", numbers: NumericOptions, args: argparse.Namespace, progress: Any
) -> MixedSound:
    """The parts of an instrument."""
    from engine.live.instrument_notes import scene_of_file
    from engine.offline.render import render

    played = scene_of_file(mixed.scene, Path(args.midi), excerpt)
    rendering = render(
        played.scene,
        seconds=numbers["seconds"],
        samplerate=samplerate_of(numbers),
        cores=None if numbers["cores"] is None else int(numbers["cores"]),
        progress=progress,
        kernel=args.kernel,
        **accuracy_options(args),
    )
    stats = rendering.stats
    remarks = [
        *describe_unknown_drums(played.file),
        *describe_leftover(played.refused, played.ignored),
        *stats.warnings,
    ]
    speed, error = stats.real_time_factor, stats.energy.error_max
    return MixedSound(mixed, rendering.audio, speed, stats.kernel, error, stats.reasons, remarks)


def play_on_voices(
    mixed: MixedPatch, excerpt: "Excerpt", numbers: NumericOptions, args: argparse.Namespace, progress: Any
) -> MixedSound:
    """The parts of a patch without a keyboard."""
    from engine.assembly.limits import build_modal_bodies
    from engine.live.midi import render_notes
    from engine.offline.trust import explain_doubts

    rate, scene = samplerate_of(numbers), mixed.scene
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**accuracy_options(args))})
    build_modal_bodies(scene, rate, scene.accuracy.scheme)
    played = render_notes(scene, args.midi, rate, numbers["seconds"], voice_count(args), progress, excerpt)
    reading = played.player.meter()
    reasons = explain_doubts(reading.newton, reading.energy_error, not reading.not_finite)
    remarks = describe_leftover([], played.keys.ignored, played.keys.stolen, played.keys.refused)
    speed, error = reading.real_time_factor, reading.energy_error
    return MixedSound(mixed, played.audio, speed, reading.kernel, error, reasons, remarks)


def mix_parts(played: list[MixedSound], is_balanced: bool) -> "tuple[np.ndarray, list[float]]":
    """The sum of all sounds, the shorter ones followed by silence, [frames, channels]; and the factor of each. A mono
    sound is on the first two channels.

    is_balanced: bring all to the same peak before their levels apply, as SI units of different pickups do not compare;
                 or else leave them in SI units
    """
    import numpy as np

    channels = max(part.audio.shape[1] for part in played)
    mix, factors = np.zeros((max(len(part.audio) for part in played), channels)), list[float]()
    for part in played:
        peak = float(np.abs(part.audio).max())
        level = 10.0 ** (part.mixed.level / 20.0)
        factors.append(level / peak if is_balanced and peak > SILENT_PEAK else level)
        width = min(channels, 2) if part.audio.shape[1] == 1 else part.audio.shape[1]
        mix[: len(part.audio), :width] += part.audio * factors[-1]
    return mix, factors
