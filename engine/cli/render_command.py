"""The command `render`: a patch becomes a sound file, as it is or played by the notes of a MIDI file."""

import argparse
import json
import sys
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import (
    describe_bodies,
    describe_leftover,
    describe_midi_file,
    print_error,
    print_faults,
    read_patch,
)
from engine.cli.mix_command import PARTS_REMEDY, mix_command, read_assignments
from engine.cli.option_checks import (
    NumericOptions,
    accuracy_options,
    check_kernel,
    check_parts,
    check_paths,
    check_rate_and_channels,
    excerpt_of,
    numeric_options,
    optional_path,
    plot_path,
    report_path,
    samplerate_of,
    scene_of_key,
    sound_path,
    voice_count,
)
from engine.cli.progress import progress_feedback
from engine.faults import Fault
from engine.output_files import (
    apply_gain,
    check_audio_format,
    count_clipped,
    describe_lowered_gain,
    error_reason,
    save_audio,
)
from engine.wording import json_safe

if TYPE_CHECKING:
    from engine.patch.scene import Scene

# what a render of notes takes no notice of
NOT_OF_MIXES = {"--trace": "trace", "--plot": "plot", "--report": "report", "--target-error": "target_error"}
NOT_OF_MIXES |= {"--oversample": "oversample", "--error-estimate": "error_estimate"}
NOT_OF_NOTES = NOT_OF_MIXES | {"--cores": "cores"}


def add_render_command(commands: "arguments.Commands") -> None:
    """Add `render` and its options."""
    parser = commands.add_parser(
        "render", help="render a patch to a sound file", description="Render a patch to a sound file."
    )
    arguments.add_patch(parser)
    help_text = "sound file to write (default: PATCH.wav in this folder, or TUNE_PATCH.wav with --midi)"
    parser.add_argument("-o", "--output", metavar="OUT.wav", help=help_text)
    arguments.add_length_and_rate(parser)
    arguments.add_sound_format(parser)
    arguments.add_gain(parser)
    arguments.add_cores(parser)
    arguments.add_kernel(parser)
    arguments.add_accuracy_options(parser)
    help_text = "choose the cheapest setting with a smaller error: 1e-4, or 0.1dB in any band"
    parser.add_argument("--target-error", metavar="E", help=help_text)
    help_text = "estimate the error of the motion with a second, several times finer rendering"
    parser.add_argument("--error-estimate", action="store_true", default=None, help=help_text)
    parser.add_argument("--midi", metavar="FILE.mid", help="play the notes of a MIDI file")
    arguments.add_parts(parser)
    help_text = "with --midi: give channels or tracks to other patches, and mix; PATCH plays the rest (see the guide)"
    parser.add_argument("--play", metavar="2=guitar,10=snare", help=help_text)
    arguments.add_key(parser, "play one note of an instrument, such as C4 or F#3")
    arguments.add_voices(parser)
    help_text = "also write the displacements, forces and energies of every sample"
    parser.add_argument("--trace", metavar="OUT.npz", help=help_text)
    help_text = (
        "with --trace: also write shapes of strings, bars, membranes and plates (at most 4000 each, 64 MB in all)"
    )
    parser.add_argument("--trace-shapes", action="store_true", default=None, help=help_text)
    arguments.add_plot(parser, "waveform, spectrogram, energies and contacts")
    arguments.add_report(parser, "the sound, plots and statistics")
    arguments.add_json(parser)
    arguments.add_verbose(parser)
    parser.set_defaults(run=render_command)


def render_command(args: argparse.Namespace) -> int:
    """Render a patch as the options say; returns the exit code."""
    scene, faults = read_patch(args.patch)
    numbers, option_faults = numeric_options(args)
    output = sound_path(args)
    targets = {"--output": output, "--trace": optional_path(args.trace)}
    option_faults += check_paths(targets | {"--plot": plot_path(args), "--report": report_path(args)})
    option_faults += check_audio_format(output, args.subtype, "--output")
    scene, note_faults = scene_of_key(scene, args)
    if args.trace_shapes and args.trace is None:
        option_faults.append(Fault("--trace-shapes", "requires --trace; give that too, with the name of a file"))
    option_faults += ignored_options(scene, args) + check_kernel(args) + check_parts(args) + note_faults
    assignments, assignment_faults = read_assignments(args)
    option_faults += assignment_faults
    if scene is not None and not option_faults:
        channels = max(scene.channels, *(each.scene.channels for each in assignments), 0)
        option_faults += check_rate_and_channels("--output", output, samplerate_of(numbers), channels)
    faults += option_faults
    if scene is None or faults:
        print_faults(faults)
        return 2
    if not args.midi:
        return scene_command(scene, numbers, args)
    if assignments:
        return mix_command(scene, assignments, numbers, args)
    return instrument_command(scene, numbers, args) if scene.instrument else midi_command(scene, numbers, args)


def ignored_options(scene: "Scene | None", args: argparse.Namespace) -> list[Fault]:
    """List the options that would have no effect, because of other options."""
    if not args.midi:
        given = [name for name in ("voices", "play") if getattr(args, name) is not None]
        return [Fault(f"--{name}", "requires --midi; give that too") for name in given]
    if args.play is not None:
        given = [option for option, name in NOT_OF_MIXES.items() if getattr(args, name) is not None]
        return [Fault(option, "cannot be combined with --play") for option in given]
    if scene is None or scene.instrument:
        message = "every key of an instrument has its own bodies; leave it out"
        return [Fault("--voices", message)] if scene is not None and args.voices is not None else []
    given = [option for option, name in NOT_OF_NOTES.items() if getattr(args, name) is not None]
    return [Fault(option, "cannot be combined with --midi") for option in given]


def scene_command(scene: "Scene", numbers: NumericOptions, args: argparse.Namespace) -> int:
    """Render a scene as its patch says it; returns the exit code."""
    from engine.cli import rendering
    from engine.report import console

    try:
        outputs = rendering.render_from_arguments(scene, numbers, args)
        companions = rendering.write_outputs(outputs, args)
    except MemoryError:
        print_error(
            "there is not enough memory for so many samples; give fewer --seconds, or no --trace, --plot or --report"
        )
        return 1
    except rendering.WriteError as error:
        print_error(error)
        return 1
    for warning in outputs.warnings:
        print(warning, file=sys.stderr)
    if args.json:
        print(json.dumps(json_safe(outputs.stats)))
    else:
        console.print_summary(outputs.stats, [str(path) for path in companions], args.verbose)
    return 0


def instrument_command(scene: "Scene", numbers: NumericOptions, args: argparse.Namespace) -> int:
    """Render an instrument that plays a MIDI file; returns the exit code."""
    from pathlib import Path

    from engine.live.instrument_notes import scene_of_file
    from engine.live.midi_notes import MidiError

    try:
        with progress_feedback("reading the notes"):
            played = scene_of_file(scene, Path(args.midi), excerpt_of(args, numbers["seconds"]))
    except MidiError as error:
        print_error(error)
        return 2
    for line in [
        *describe_midi_file(args.midi, played.file, PARTS_REMEDY),
        *describe_leftover(played.refused, played.ignored),
    ]:
        print(line, file=sys.stderr)
    return scene_command(played.scene, numbers, args)


def midi_command(scene: "Scene", numbers: NumericOptions, args: argparse.Namespace) -> int:
    """Render the notes of a MIDI file; returns the exit code."""
    from engine.assembly import limits
    from engine.live import midi, midi_notes
    from engine.offline.trust import explain_doubts
    from engine.report import console

    rate, output = samplerate_of(numbers), sound_path(args)
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**accuracy_options(args))})
    try:
        limits.build_modal_bodies(scene, rate, scene.accuracy.scheme)
        with progress_feedback("rendering", f"{voice_count(args)} voices of {describe_bodies(scene)}") as progress:
            excerpt = excerpt_of(args, numbers["seconds"])
            audio, player, voices, file = midi.render_notes(
                scene, args.midi, rate, numbers["seconds"], voice_count(args), progress, excerpt
            )
        audio, gain = apply_gain(audio, float(abs(audio).max()), numbers["gain"], args.subtype)
        save_audio(output, audio, rate, args.subtype)
        cut = count_clipped(output, audio, gain, args.subtype)
    except midi_notes.MidiError as error:
        print_error(error)
        return 2
    except MemoryError:
        print_error("there is not enough memory for so many samples; give fewer --seconds or --voices")
        return 1
    except (OSError, RuntimeError) as error:
        print_error(f"cannot write {output} ({error_reason(error)})")
        return 1
    if cut:
        print(f"{output}: {cut}", file=sys.stderr)
    for warning in describe_lowered_gain(output, gain, numbers["gain"]):
        print(warning, file=sys.stderr)
    reading, played = player.meter(), voices.played_notes()
    for line in [
        *describe_midi_file(args.midi, file, PARTS_REMEDY),
        *describe_leftover([], voices.ignored, voices.stolen, voices.refused),
    ]:
        print(line, file=sys.stderr)
    reasons = explain_doubts(reading.newton, reading.energy_error, not reading.not_finite)
    stats = {"patch": args.patch, "output": str(output), "seconds": len(audio) / rate, "gain_db": gain}
    stats |= {"live": reading.as_dict(), "notes": played, "trusted": not reasons, "reasons": reasons}
    stats |= {"samplerate": rate, "channels": audio.shape[1], "peak": float(abs(audio).max())}
    stats |= {
        "real_time_factor": reading.real_time_factor,
        "kernel": reading.kernel,
        "clipped": cut.count if cut else 0,
    }
    if args.json:
        print(json.dumps(json_safe(stats)))
    else:
        console.print_notes_summary(stats, player.voices, args.verbose)
    return 0
