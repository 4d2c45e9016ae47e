"""Values of options, as numbers and paths, and all faults of them, so that these can be told at once.

The parser leaves every value as text; it would stop at the first fault.
"""

import argparse
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from engine import audio_formats
from engine.cli.arguments import ACCURACY_OPTIONS, VOICES
from engine.compiler.kernel_name import read_kernel_name
from engine.faults import Fault, PatchError
from engine.files import is_folder
from engine.output_files import BITS, TRACE_ENDINGS, explain_unwritable, is_stream, is_writable_folder, resolve_links
from engine.report.figures import PICTURE_ENDINGS, PLOT_PANELS, PLOT_STYLES
from engine.sound.form import PRESETS, RANGES, SoundForm, with_preset
from engine.wording import join_with_or

if TYPE_CHECKING:
    from engine.live.midi_parts import Excerpt
    from engine.patch.scene import Scene

DEFAULT_SAMPLERATE = 44_100  # Hz, unless an option says otherwise
MAX_VOICES = 64
MIDI_CHANNELS = 16
MAX_LATENCY = 10.0  # s
MAX_TEMPO = 1000.0  # quarter notes per minute

# of a file to be written: what it is called, and the endings of its name
FILE_KINDS = {
    "--report": ("page", (".html", ".htm")),
    "--plot": ("picture", PICTURE_ENDINGS),
    "--film": ("film", (".mp4",)),
    "--trace": ("trace", TRACE_ENDINGS),
    "--event-log": ("log", (".json",)),
}
GROWING = ("--record", "--event-log")  # files that grow beside their names
DEFAULT_ENDINGS = {"--report": ".html", "--plot": ".png", "--film": ".mp4"}  # of files that are called like the sound


def read_options(args: argparse.Namespace) -> list[Fault]:
    """Turn the values of options into numbers, in place, and put those of accuracy together as `args.accuracy`. Returns
    what is wrong with any of them; those then stay texts."""
    faults = _read_numbers(args)
    options = vars(args)
    if (text := options.get("voices")) is not None:
        if text.isdecimal() and 1 <= int(text) <= MAX_VOICES:
            args.voices = int(text)
        else:
            faults.append(Fault("--voices", f'"{text}" is not a number of voices; give 1 to {MAX_VOICES}'))
    for name in ("plot", "report"):
        if options.get(name) is not None and find_spec("matplotlib") is None:
            faults.append(Fault(f"--{name}", "needs matplotlib; run uv sync --extra plot, or pip install matplotlib"))
    if options.get("film") is not None and not all(map(find_spec, ("imageio_ffmpeg", "matplotlib"))):
        faults.append(Fault("--film", 'needs FFmpeg and matplotlib; run pip install "fdh-engine[film]"'))
    if (options.get("trace") or "").endswith(".nc") and find_spec("xarray") is None:
        faults.append(Fault("--trace", "needs xarray for .nc; run uv sync --extra sweep, or give .npz, .mat or .csv"))
    faults += check_sound_options(args) if "trim" in options else []
    return faults + check_plot_style(args) + _read_target_error(args) + _read_accuracy(args)


def _read_numbers(args: argparse.Namespace) -> list[Fault]:
    """Turn lengths, rate, gain and cores into numbers, in place; list their faults."""
    from engine.patch.frames import SAMPLE_RATE_RANGE
    from engine.patch.scene_tables import MAX_LEVEL
    from engine.patch.tables import MAX_SECONDS

    ranges = {"seconds": (0.0, MAX_SECONDS, "s"), "samplerate": (*SAMPLE_RATE_RANGE, "Hz")}
    ranges |= {"hold": ranges["seconds"]}
    ranges |= {"gain": (-MAX_LEVEL, MAX_LEVEL, "dB"), "cores": (1, 1024, "cores")}
    ranges |= {"tempo": (1.0, MAX_TEMPO, "quarter notes per minute")}
    ranges |= {"loudness": (*RANGES["loudness"], "LUFS"), "loop": (*RANGES["loop"], "s")}
    faults: list[Fault] = []
    for name, (low, high, unit) in ranges.items():
        if (text := vars(args).get(name)) is None:
            continue
        range_text = f"give {'more than 0, at most' if low == 0 else f'{low:g} to'} {high:g} {unit}"
        try:
            number = float(text)
        except ValueError:
            faults.append(Fault(f"--{name}", f'"{text}" is not a number; {range_text}'))
            continue
        is_whole = name in ("samplerate", "cores")
        if not low <= number <= high or number == low == 0:
            faults.append(Fault(f"--{name}", f"{text} is out of range; {range_text}"))
        elif is_whole and number != int(number):
            faults.append(Fault(f"--{name}", f"{text} is not a whole number; {range_text}"))
        else:
            setattr(args, name, int(number) if is_whole else number)
    return faults


def check_sound_options(args: argparse.Namespace) -> list[Fault]:
    """List the faults of the options that say what becomes of a sound in its file, and take a preset's rate."""
    faults, program = list[Fault](), vars(args)["for"]
    if program is not None and program not in PRESETS:
        faults.append(Fault("--for", f'"{program}" is not known; give {join_with_or(PRESETS)}'))
    elif program is not None and args.samplerate is None:
        args.samplerate = PRESETS[program].samplerate
    if args.loudness is not None and args.gain is not None:
        faults.append(Fault("--loudness", "cannot be combined with --gain; give one of them"))
    if args.loop is not None and args.trim:
        faults.append(Fault("--loop", "cannot be combined with --trim; give one of them"))
    if not faults and args.dither and sound_form(args).subtype not in BITS:
        faults.append(Fault("--dither", f"is for samples that are rounded; give --subtype {join_with_or(BITS)}"))
    return faults


def sound_form(args: argparse.Namespace) -> SoundForm:
    """Return the form that a sound gets in its file."""
    options = vars(args)
    if "trim" not in options:
        return SoundForm(args.subtype, args.gain)
    fade = False if args.no_fade else True if args.trim else None
    form = SoundForm(args.subtype, args.gain, args.loudness, args.trim, fade, args.loop, args.dither)
    return form if options["for"] is None else with_preset(form, options["for"])


def samplerate_of(args: argparse.Namespace) -> int:
    """The sample rate to render at, Hz."""
    return int(args.samplerate or DEFAULT_SAMPLERATE)


def voice_count(args: argparse.Namespace) -> int:
    """Return the number of notes that may sound at a time."""
    return int(args.voices or VOICES)


def _read_accuracy(args: argparse.Namespace) -> list[Fault]:
    """Put the options of accuracy together as `args.accuracy`, as numbers where possible; None leaves a setting to the
    patch. Returns their faults."""
    from engine.patch.accuracy import Accuracy
    from engine.patch.error_messages import describe_value_error

    args.accuracy, faults = {}, list[Fault]()
    for name, kind in ACCURACY_OPTIONS.items():
        value = vars(args).get(name)
        if value is not None:
            with suppress(ValueError):
                value = kind(value)
            if message := describe_value_error(Accuracy, name, value):
                faults.append(Fault("--" + name.replace("_", "-"), message))
        args.accuracy[name] = value
    return faults


def _read_target_error(args: argparse.Namespace) -> list[Fault]:
    """Turn the value of --target-error, such as 1e-4 or 0.1dB, into one of --max-error. Returns its faults."""
    from engine.patch.accuracy import Accuracy
    from engine.patch.error_messages import describe_value_error

    text = vars(args).get("target_error")
    if text is None:
        return []
    if args.max_error is not None:
        return [Fault("--target-error", "sets --max-error; give only one of the two")]
    try:
        decibels = text.lower().endswith("db")
        amount = 10.0 ** (float(text[:-2]) / 20.0) - 1.0 if decibels else float(text)
    except (ValueError, OverflowError):
        remedy = "give a ratio such as 1e-4, or decibels such as 0.1dB"
        return [Fault("--target-error", f'"{text}" is not an error; {remedy}')]
    if message := describe_value_error(Accuracy, "max_error", amount):
        return [Fault("--target-error", message)]
    args.max_error = args.target_error = amount
    return []


def check_plot_style(args: argparse.Namespace) -> list[Fault]:
    """List the faults of --plot-style and --plot-panels."""
    faults, given = list[Fault](), {"--plot-style": "plot_style", "--plot-panels": "plot_panels"}
    for option, noun, texts, known in (
        ("--plot-style", "style", [vars(args).get("plot_style")], PLOT_STYLES),
        ("--plot-panels", "panel", plot_panels(args), PLOT_PANELS),
    ):
        wrong = [text for text in texts if text is not None and text not in known]
        if wrong:
            faults.append(Fault(option, f'"{wrong[0]}" is not a {noun}; give {join_with_or(known)}'))
        elif vars(args).get(given[option]) is not None and args.plot is None:
            faults.append(Fault(option, "requires --plot; give that too"))
    return faults


def plot_panels(args: argparse.Namespace) -> list[str]:
    """Return the panels of a plot that an option names; none if it names none."""
    return [name.strip() for name in (vars(args).get("plot_panels") or "").split(",") if name.strip()]


def excerpt_of(args: argparse.Namespace) -> "Excerpt":
    """Return the excerpt of a MIDI file that the options choose."""
    from engine.live.midi_parts import Excerpt

    channels = frozenset(int(channel) for channel in (args.channels or "").split(",") if channel)
    tracks = tuple(track.strip() for track in (args.tracks or "").split(",") if track)
    begin = 0.0 if vars(args).get("keep_start") else None
    return Excerpt(channels, tracks, begin=begin, seconds=args.seconds, tempo=args.tempo)


def check_parts(args: argparse.Namespace) -> list[Fault]:
    """List the faults of the options that choose parts of a MIDI file."""
    from engine.live.midi_files import is_midi_file

    faults = []
    for option, text in (("--channels", args.channels), ("--tracks", args.tracks), ("--tempo", args.tempo)):
        if text is not None and not (args.midi and is_midi_file(args.midi)):
            faults.append(Fault(option, "requires --midi with a file; give that too"))
        elif isinstance(text, str) and option != "--tempo" and not all(item.strip() for item in text.split(",")):
            faults.append(Fault(option, f'"{text}" is not a list; separate its items by commas, such as 1,2'))
    numbers = [channel.strip() for channel in (args.channels or "").split(",")]
    if args.channels and not faults and not all(n.isdecimal() and 1 <= int(n) <= MIDI_CHANNELS for n in numbers):
        message = f'"{args.channels}" are not MIDI channels; give numbers from 1 to {MIDI_CHANNELS}, such as 1,2'
        faults.append(Fault("--channels", message))
    return faults


def check_kernel(args: argparse.Namespace) -> list[Fault]:
    """List the faults of the kernel that --kernel or the environment names."""
    try:
        read_kernel_name(args.kernel)
    except ValueError as error:
        return [Fault("--kernel", str(error))]
    return []


def default_sound(args: argparse.Namespace) -> Path:
    """The name of a sound file that no option names: like the patch, in this folder; of a MIDI file, like the file and
    the patch."""
    options = vars(args)
    midi = options.get("midi")
    tune = [Path("midi" if midi == "-" else midi).stem] if midi else []
    return Path(f"{'_'.join([*tune, 'mix' if options.get('play') else Path(args.patch).stem])}.wav")


def read_paths(args: argparse.Namespace, *options: str) -> list[Fault]:
    """Turn the names of files to be written into paths, in place; list their faults. The sound always has a name, and
    a picture or a page that is given without one is called like the sound."""
    faults, named = list[Fault](), {option: option.strip("-").replace("-", "_") for option in options}
    if "--output" in options:
        if args.output == "":
            faults.append(Fault("--output", "is empty; give the name of a file"))
        args.output = Path(args.output) if args.output else default_sound(args)
    for option, name in named.items():
        text = getattr(args, name)
        if text == "" and option in DEFAULT_ENDINGS:
            setattr(args, name, Path(args.output or default_sound(args)).with_suffix(DEFAULT_ENDINGS[option]))
        else:
            setattr(args, name, Path(text) if text else None)
    paths = {option: path for option, name in named.items() if (path := getattr(args, name)) is not None}
    return faults + [fault for option in paths for fault in check_path(option, paths)]


def check_path(option: str, paths: dict[str, Path]) -> list[Fault]:
    """List the faults of a file to be written. paths: of all files, by their options"""
    faults, path = list[Fault](), paths[option]
    noun, endings = FILE_KINDS.get(option, ("", ()))
    if endings and path.suffix.lower() not in endings:
        faults.append(Fault(option, f'"{path.name}" is not the name of a {noun}; end it in {join_with_or(endings)}'))
    elif not is_folder(path.parent):
        faults.append(Fault(option, f"no such folder: {path.parent}; make it, or write elsewhere"))
    elif is_folder(path):
        faults.append(Fault(option, f"{path} is a folder; give the name of a file, such as {path / 'sound.wav'}"))
    elif reason := explain_unwritable(path):
        faults.append(Fault(option, f"{path} is {reason}; write elsewhere"))
    elif is_stream(path):
        if option in GROWING:
            faults.append(Fault(option, f"{path} is a pipe or a device; give the name of a file, which can grow"))
    elif not is_writable_folder(resolve_links(path).parent):
        where = "the folder you are in" if path.parent == Path() else path.parent
        faults.append(Fault(option, f"{where} cannot be written to; write elsewhere: {option} FOLDER/{path.name}"))
    if sum(resolve_links(path) == resolve_links(other) for other in paths.values()) > 1:
        faults.append(Fault(option, f"{path} would be written twice; give two different names"))
    return faults


def check_rate_and_channels(option: str, output: Path, samplerate: int, channels: int) -> list[Fault]:
    """List the faults of a sound that the format of its file cannot hold."""
    message = audio_formats.explain_unsupported_format(output, samplerate, channels)
    return [Fault(option, message)] if message else []


def scene_of_key(scene: "Scene | None", args: argparse.Namespace) -> tuple["Scene | None", list[Fault]]:
    """The scene, or that of one note of it if the options ask for one; and the faults of these options."""
    from engine.instrument.tables import DEFAULT_VELOCITY
    from engine.patch.note_scene import scene_of_note
    from engine.patch.reader import locate_faults

    velocity = args.velocity
    if velocity is not None and not (velocity.isdecimal() and 1 <= int(velocity) <= 127):
        return scene, [Fault("--velocity", f'"{velocity}" is not a velocity; give a whole number from 1 to 127')]
    if args.key is None:
        return scene, [Fault("--velocity", "requires --key; give that too")] if velocity is not None else []
    if getattr(args, "midi", None):
        return scene, [Fault("--key", "cannot be combined with --midi")]
    if scene is None:
        return None, []
    try:
        return scene_of_note(scene, args.key, int(velocity or DEFAULT_VELOCITY)), []
    except PatchError as error:
        return None, locate_faults(args.patch, error.faults)
    except ValueError as error:
        return scene, [Fault("--key", str(error))]


def parse_latency(text: str | None) -> str | float | None:
    """A latency as sounddevice takes it: low, high, or seconds. Raises ValueError."""
    if text in (None, "low", "high"):
        return text
    seconds = float(text or "")
    if not 0.0 < seconds <= MAX_LATENCY:
        raise ValueError(text)
    return seconds
