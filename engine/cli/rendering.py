"""A rendering with its files: everything is computed first, and then the sound and its companions are written."""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.cli.messages import describe_bodies, print_messages, write_file
from engine.cli.option_checks import (
    parse_error_target,
    samplerate_of,
)
from engine.cli.progress import Progress, progress_feedback
from engine.output_files import save_trace, to_utf8_text, write_text

if TYPE_CHECKING:
    import numpy as np

    from engine.analysis.profile import Profile
    from engine.analysis.work_precision import WorkPrecisionStudy
    from engine.api.rendering import Rendering
    from engine.api.sound_file import LevelledSound
    from engine.patch.scene import Scene

CHOSEN_SETTING_KEYS = ("setting", "error", "bands_db", "ns_per_sample")


@dataclass(frozen=True)
class Outputs:
    """Results of a rendering: all that is to be printed and written."""

    stats: dict[str, Any]  # as `--json` prints them: of the rendering, and of the file
    warnings: list[str]
    files: dict[Path, Callable[[Path], object]]  # what writes each of them; the sound is the first

    def write(self) -> list[str]:
        """Write all files; return the names of those beside the sound. Raises CommandError."""
        with progress_feedback("writing the files"):
            for path, write in self.files.items():
                write_file(path, write)
        return [str(path) for path in self.files][1:]


def bring_to_level(
    args: argparse.Namespace, audio: "np.ndarray", is_silent: bool = False
) -> "tuple[LevelledSound, dict[str, Any]]":
    """Bring a sound to the level of the file that the options name. Returns it with its statistics.

    audio: [frames, channels], SI units; is_silent: as of engine.api.sound_file.SoundFile.bring_to_level
    """
    from engine.api.sound_file import SoundFile

    file = SoundFile(args.output, args.subtype, args.gain)
    sound = file.bring_to_level(audio, samplerate_of(args), is_silent)
    return sound, {"patch": args.patch} | sound.statistics


def write_sound(args: argparse.Namespace, audio: "np.ndarray") -> dict[str, Any]:
    """Write a sound to the file that the options name, and print what there is to say of it; return its statistics.
    Raises CommandError. audio: [frames, channels], SI units"""
    sound, stats = bring_to_level(args, audio)
    write_file(sound.file.path, lambda path: sound.write())
    print_messages(sound.warnings)
    return stats


def render_scene(scene: "Scene", args: argparse.Namespace, progress: Progress, **settings: Any) -> "Rendering":
    """Render a scene as the options say. settings: others of `engine.render`. Raises BuildError, MemoryError."""
    from engine.api.rendering import render

    settings = {"cores": args.cores, "progress": progress, "kernel": args.kernel} | args.accuracy | settings
    return render(scene, args.seconds, samplerate_of(args), **settings)


def render_with_answers(scene: "Scene", args: argparse.Namespace) -> "tuple[Rendering, dict[str, Any]]":
    """Render a scene. Returns the rendering, and the answers to --target-error and --error-estimate by the names of
    `--json`."""
    from engine.analysis.error_estimate import estimate_error

    accuracy, answers = dict[str, Any](), dict[str, Any]()
    if args.target_error is not None:
        accuracy, answers["chosen"] = cheapest_setting(scene, args)
    trace = any(given is not None for given in (args.trace, args.plot, args.report))
    with progress_feedback("rendering", describe_bodies(scene)) as progress:
        rendering = render_scene(scene, args, progress, trace=trace, trace_shapes=bool(args.trace_shapes), **accuracy)
    if args.error_estimate and not math.isclose(rendering.stats.peak, 0.0):
        with progress_feedback("estimating the error") as progress:
            estimate = estimate_error(scene, rendering, progress, cores=rendering.stats.cores, kernel=args.kernel)
        answers["error_estimate"] = estimate.as_dict()
    return rendering, answers


def render_from_arguments(
    scene: "Scene", args: argparse.Namespace, comparison: "WorkPrecisionStudy | None" = None
) -> Outputs:
    """Render a scene, with all that the options ask for beside its sound. Raises BuildError, MemoryError.

    comparison: what accuracy costs, for the page
    """
    from engine.analysis.string_shape import string_shape

    text = "" if args.report is None else Path(args.patch).read_text("utf-8-sig")  # as it is rendered
    rendering, answers = render_with_answers(scene, args)
    silence = rendering.silence
    sound, written = bring_to_level(args, rendering.audio, silence is not None)
    stats = rendering.stats.as_dict() | written | {"silent": silence} | answers
    warnings = [f"{args.patch}: silent; {silence}"] if silence else []
    warnings += [f"{args.patch}: {warning}" for warning in rendering.stats.warnings] + sound.warnings
    shape = None
    if (args.plot is not None and comparison is None) or args.report is not None:
        with progress_feedback("computing the shape of a string"):
            shape = string_shape(scene, rendering)
    title = scene.title or Path(args.patch).stem

    def draw(path: Path) -> None:
        from engine.report.plots import plot_rendering

        if comparison is not None:
            plot_comparison(comparison, path, args)
        else:
            plot_rendering(rendering, title, path, shape, args.plot_style or "screen")

    files: dict[Path, Callable[[Path], object]] = {sound.file.path: lambda path: sound.write()}
    if args.trace is not None:
        files[args.trace] = lambda path: save_trace(path, rendering.trace or {})
    if args.plot is not None:
        files[args.plot] = draw
    if args.report is not None:
        from engine.report.html import compose_page

        profile = measure_profile(scene, rendering)
        with progress_feedback("drawing the page"):
            shown = compose_page(title, text, rendering, sound.audio, stats, profile, comparison, shape)
        files[args.report] = lambda path: write_text(path, to_utf8_text(shown))
    return Outputs(stats, warnings, files)


def measure_profile(scene: "Scene", rendering: "Rendering") -> "Profile":
    """Measure what the parts of a scene cost, at the settings of a rendering."""
    from engine.analysis.profile import profile_scene

    accuracy = rendering.stats.accuracy
    with progress_feedback("measuring costs") as progress:
        rate = rendering.samplerate * accuracy["oversample"]
        return profile_scene(scene, rendering.stats.seconds, rate, progress, **accuracy)


def run_work_precision(scene: "Scene", seconds: float | None, args: argparse.Namespace) -> "WorkPrecisionStudy":
    """Measure what accuracy costs (engine.analysis.work_precision)."""
    from engine.analysis.work_precision import measure_work_precision

    with progress_feedback("comparing settings") as progress:
        return measure_work_precision(scene, seconds, samplerate_of(args), progress)


def plot_comparison(study: "WorkPrecisionStudy", path: Path, args: argparse.Namespace) -> None:
    """Plot what accuracy costs to a file."""
    from engine.report.work_precision_plot import plot_work_precision

    plot_work_precision(study, Path(args.patch).stem, path, args.plot_style or "screen")


def cheapest_setting(scene: "Scene", args: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """Choose the cheapest setting that meets the target error, by a short study; return it with its statistics."""
    from engine.analysis.work_precision import cheapest_within

    amount, decibels = parse_error_target(args.target_error)
    study = run_work_precision(scene, None, args)
    target = {"asked": args.target_error, "horizon": study["horizon"], "unmeasured": study["unmeasured"]}
    if study["unmeasured"]:
        return {}, dict.fromkeys(CHOSEN_SETTING_KEYS) | target | {"met": False}
    row, met = cheapest_within(study, amount, decibels)
    return row["changes"], {key: row[key] for key in CHOSEN_SETTING_KEYS} | target | {"met": met}
