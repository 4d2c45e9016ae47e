"""The command `render`: a patch becomes a sound file, as it is or played by the notes of a MIDI file."""

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import (
    describe_bodies,
    describe_midi_file,
    memory_errors_explained,
    print_messages,
    print_result,
    require_scene,
)
from engine.cli.mix_command import MixedPatch, mix_command, read_assignments
from engine.cli.notes import (
    PARTS_REMEDY,
    add_score_with_levels,
    describe_levels,
    levels_of_file,
    note_errors_explained,
    play_notes,
)
from engine.cli.option_checks import (
    check_kernel,
    check_parts,
    check_rate_and_channels,
    excerpt_of,
    read_options,
    read_paths,
    samplerate_of,
    scene_of_key,
    voice_count,
)
from engine.cli.progress import progress_feedback
from engine.cli.stems import check_stems
from engine.cli.tuning_options import add_tuning_options, read_tuned_patch
from engine.faults import Fault
from engine.output_files import check_audio_format
from engine.report.figures import PLOT_PANELS
from engine.wording import program_name

if TYPE_CHECKING:
    import numpy as np

    from engine.patch.scene import Scene

# what a render of notes takes no notice of
NOT_OF_MIXES = {"--trace": "trace", "--plot": "plot", "--report": "report", "--film": "film"}
NOT_OF_MIXES |= {"--oversample": "oversample", "--error-estimate": "error_estimate"}
LEVEL_OF_PATCH = "patch"
NOT_OF_NOTES = NOT_OF_MIXES | {"--cores": "cores"}


def add_render_command(commands: "arguments.Commands") -> None:
    """Add `render` and its options."""
    parser = arguments.add_command(commands, "render", render_command, "render a patch to a sound file")
    arguments.add_patch(parser)
    help_text = "sound file to write (default: PATCH.wav in this folder, or TUNE_PATCH.wav with --midi)"
    parser.add_argument("-o", "--output", metavar="OUT.wav", help=help_text)
    level = "--level", LEVEL_OF_PATCH, "patch: at the level of the patch, as in live sound, instead of normalised"
    arguments.add_options(parser, "--seconds", "--samplerate", "--subtype", "--gain", level, "--cores", "--kernel")
    arguments.add_sound_options(parser)
    arguments.add_accuracy_options(parser)
    help_text = "choose the steps by error, and render until the error is below 1e-4, or 0.1dB"
    arguments.add_options(parser, ("--target-error", "E", help_text))
    help_text = "estimate the error of the motion with a second, several times finer rendering"
    parser.add_argument("--error-estimate", action="store_true", default=None, help=help_text)
    midi = "--midi", "FILE.mid", "play the notes of a MIDI file"
    help_text = "with --midi: give channels or tracks to other patches, and mix; PATCH plays the rest (see the guide)"
    play = "--play", "2=guitar,10=snare", help_text
    stems = "--stems", "FOLDER", "with --midi: also write each part to a file of its own, and a project for REAPER"
    key = "--key", "KEY", "play one note of an instrument, such as C4 or F#3"
    add_tuning_options(parser)
    trace = "--trace", "OUT.npz", "also write what moves in every sample: .npz, .nc (xarray), .mat (MATLAB) or .csv"
    arguments.add_options(parser, midi, "--channels", "--tracks", "--tempo", play, stems, key, "--velocity")
    arguments.add_options(parser, "--voices", trace)
    help_text = (
        "with --trace: also write shapes of strings, bars, membranes and plates (at most 4000 each, 64 MB in all)"
    )
    parser.add_argument("--trace-shapes", action="store_true", default=None, help=help_text)
    text = "with --midi: begin where the file begins, not at its first note"
    parser.add_argument("--keep-start", action="store_true", help=text)
    arguments.add_plot(parser, "waveform, spectrogram, energies and contacts")
    text = f"plot these panels, such as waveform,contact, of {', '.join(PLOT_PANELS)} (default: all)"
    arguments.add_options(parser, ("--plot-panels", "NAMES", text))
    arguments.add_report(parser, "the sound, plots and statistics")
    text = "also write a film of what moves, slowed, with the sound (default: next to the sound file)"
    parser.add_argument("--film", metavar="OUT.mp4", nargs="?", const="", help=text)
    arguments.add_json(parser)
    help_text = "also print iterations, energies and effects (--json prints everything)"
    parser.add_argument("--verbose", action="store_true", help=help_text)


def render_command(args: argparse.Namespace) -> int:
    """Render a patch as the options say; returns the exit code."""
    scene, faults = read_tuned_patch(args.patch, args)
    option_faults = read_options(args)
    option_faults += read_paths(args, "--output", "--trace", "--plot", "--report", "--film")
    option_faults += check_audio_format(args.output, args.subtype, "--output")
    scene, note_faults = scene_of_key(scene, args)
    if args.trace_shapes and args.trace is None:
        option_faults.append(Fault("--trace-shapes", "requires --trace; give that too, with the name of a file"))
    option_faults += check_film(scene, args)
    option_faults += ignored_options(scene, args) + check_kernel(args) + check_parts(args) + note_faults
    assignments, assignment_faults = read_assignments(args)
    option_faults += check_stems(args.stems, bool(args.midi))
    option_faults += assignment_faults + check_level(scene, [each.mixed for each in assignments], args)
    if scene is not None and not option_faults:
        channels = max(scene.channels, *(each.mixed.scene.channels for each in assignments), 0)
        option_faults += check_rate_and_channels("--output", args.output, samplerate_of(args), channels)
    scene = require_scene(scene, faults + option_faults)
    if args.level is not None:
        args.gain = 0.0 if assignments else scene.level  # a mix applies the level of each patch by itself
    if not args.midi:
        return scene_command(scene, args)
    if assignments or args.stems is not None:
        return mix_command(scene, assignments, args)
    return instrument_command(scene, args) if scene.has_keys else midi_command(scene, args)


def ignored_options(scene: "Scene | None", args: argparse.Namespace) -> list[Fault]:
    """List the options that would have no effect, because of other options."""
    if not args.midi:
        given = [name for name in ("voices", "play") if getattr(args, name) is not None]
        given += ["keep-start"] * args.keep_start
        return [Fault(f"--{name}", "requires --midi; give that too") for name in given]
    if args.play is not None or args.stems is not None:
        given = [option for option, name in NOT_OF_MIXES.items() if getattr(args, name) is not None]
        mixed = "--play" if args.play is not None else "--stems"
        return [Fault(option, f"cannot be combined with {mixed}") for option in given]
    if scene is None or scene.has_keys:
        message = "every key of an instrument has its own bodies; leave it out"
        return [Fault("--voices", message)] if scene is not None and args.voices is not None else []
    given = [option for option, name in NOT_OF_NOTES.items() if getattr(args, name) is not None]
    return [Fault(option, "cannot be combined with --midi") for option in given]


def check_film(scene: "Scene | None", args: argparse.Namespace) -> list[Fault]:
    """List the faults of --film."""
    from engine.offline.shape_snapshots import body_shape

    if args.film is None or scene is None or any(body_shape(body) is not None for body in scene.body):
        return []
    return [Fault("--film", "a film shows strings, bars, heads and plates, and the patch has none; leave it out")]


def check_level(scene: "Scene | None", others: list[MixedPatch], args: argparse.Namespace) -> list[Fault]:
    """List the faults of --level. others: the patches beside PATCH that play"""
    if args.level is None:
        return []
    if args.level != LEVEL_OF_PATCH:
        return [Fault("--level", f'"{args.level}" is not known; give {LEVEL_OF_PATCH}')]
    if given := [option for option in ("gain", "loudness") if getattr(args, option) is not None]:
        return [Fault("--level", f"cannot be combined with --{given[0]}; give one of them")]
    patches = {mixed.patch: mixed.scene for mixed in others} | ({} if scene is None else {args.patch: scene})
    return [
        Fault("--level", f"{path} gives no level; {program_name()} level {path} measures the one to add to it")
        for path, patch in patches.items()
        if patch.level is None
    ]


def scene_command(
    scene: "Scene", args: argparse.Namespace, levels: "Callable[[np.ndarray], np.ndarray] | None" = None
) -> int:
    """Render a scene as its patch says it; returns the exit code. levels: brings its sound to those of a MIDI file"""
    from engine.cli import rendering
    from engine.report.console import print_summary

    with memory_errors_explained("give fewer --seconds, or no --trace, --plot or --report"):
        outputs = rendering.render_from_arguments(scene, args, levels=levels)
        companions = outputs.write()
    print_messages(outputs.warnings)
    print_result(args.json, outputs.stats, lambda: print_summary(outputs.stats, companions, args.verbose))
    return 130 if outputs.is_interrupted else 0


def instrument_command(scene: "Scene", args: argparse.Namespace) -> int:
    """Render an instrument that plays a MIDI file; returns the exit code."""
    with note_errors_explained(), progress_feedback("reading the notes"):
        scene, levels, lines = add_score_with_levels(scene, args)
    print_messages(lines)
    return scene_command(scene, args, levels)


def midi_command(scene: "Scene", args: argparse.Namespace) -> int:
    """Render the notes of a MIDI file; returns the exit code."""
    from engine.cli.rendering import describe_interruption, write_sound
    from engine.report.console import print_notes_summary

    voices = voice_count(args)
    with note_errors_explained():
        with progress_feedback("rendering", f"{voices} voices of {describe_bodies(scene)}") as progress:
            notes = play_notes(scene, excerpt_of(args), args, progress)
        levels = levels_of_file(notes.file)
        audio = levels.apply(notes.audio, samplerate_of(args))
        stats = write_sound(scene, args, audio, notes.readings.kernel)
    lines = describe_midi_file(args.midi, notes.file, PARTS_REMEDY) + describe_levels(args.midi, levels)
    lines += notes.remarks
    if notes.is_interrupted:
        lines.append(describe_interruption(notes.audio, samplerate_of(args), notes.seconds, []))
    print_messages(lines)
    stats |= {"live": notes.readings.as_dict(), "notes": notes.played}
    stats |= {"trusted": not notes.reasons, "reasons": notes.reasons, "warnings": notes.warnings}
    stats["interrupted"] = notes.is_interrupted
    stats |= {name: notes.readings[name] for name in ("real_time_factor", "kernel", "table_digest")}
    print_result(args.json, stats, lambda: print_notes_summary(stats, voices, args.verbose))
    return 130 if notes.is_interrupted else 0
