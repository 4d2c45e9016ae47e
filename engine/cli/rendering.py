"""A rendering with its files: everything is computed first, and then the sound and its companions are written."""

import argparse
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from engine.cli.messages import describe_bodies, print_messages, write_file
from engine.cli.option_checks import plot_panels, samplerate_of, sound_form
from engine.cli.progress import Progress, progress_feedback
from engine.faults import BuildError, RenderInterrupted
from engine.output_files import to_utf8_text, write_text
from engine.wording import join_with_or

if TYPE_CHECKING:
    import numpy as np

    from engine.analysis.error_estimate import ErrorEstimate
    from engine.analysis.profile import Profile
    from engine.analysis.work_precision import WorkPrecisionStudy
    from engine.api.rendering import Rendering
    from engine.patch.scene import Scene
    from engine.sound.about import About
    from engine.sound.sound_file import PreparedSound

R = TypeVar("R")
ESTIMATED_PARTS = 0.05, 0.1, 0.2, 0.5, 1.0  # of a sound, whose error is estimated unasked: others than the first if
# nothing touches in it, and contacts last only a few steps
ESTIMATE_SHARE = 0.1  # of the time that a command has taken so far: what that may cost
ROUNDING = 1e-11  # relative
TARGETED_SHARE = 0.5  # of the error that is asked for
LEAST_GAIN = 0.95  # of the error before: if it falls by less, it is one that more steps do not make smaller
MAX_RENDERINGS = 4  # until the error is as small as it should be


@dataclass(frozen=True)
class Outputs:
    """Results of a rendering: all that is to be printed and written."""

    stats: dict[str, Any]  # as `--json` prints them: of the rendering, and of the file
    warnings: list[str]
    is_interrupted: bool
    files: dict[Path, Callable[[Path], object]]  # what writes each of them; the sound is the first

    def write(self) -> list[str]:
        """Write all files; return the names of those beside the sound. Raises CommandError."""
        with progress_feedback("writing the files"):
            for path, write in self.files.items():
                write_file(path, write)
        return [str(path) for path in self.files][1:]


def prepare_sound(
    args: argparse.Namespace, audio: "np.ndarray", about: "About", is_silent: bool = False
) -> "tuple[PreparedSound, dict[str, Any]]":
    """Bring a sound into the form of the file that the options name. Returns it with its statistics.

    audio: [frames, channels], SI units; is_silent: as of engine.sound.sound_file.SoundFile.prepare
    """
    from engine.sound.sound_file import SoundFile

    file = SoundFile(args.output, sound_form(args), about)
    sound = file.prepare(audio, samplerate_of(args), is_silent)
    return sound, {"patch": args.patch} | sound.statistics


def about_patch(scene: "Scene", args: argparse.Namespace, kernel: str) -> "About":
    """Return what the file of a sound says of itself."""
    from engine.instrument.key_names import parse_key
    from engine.sound.about import About

    path, key = Path(args.patch), getattr(args, "key", None)
    title = scene.title or path.stem
    text = path.read_text("utf-8-sig", "replace")
    number = None if key is None else parse_key(key)
    return About(title, path.name, text, kernel=kernel, key=number, author=scene.author, licence=scene.licence)


def write_sound(scene: "Scene", args: argparse.Namespace, audio: "np.ndarray", kernel: str) -> dict[str, Any]:
    """Write a sound to the file that the options name, and print what there is to say of it; return its statistics.
    Raises CommandError. audio: [frames, channels], SI units"""
    sound, stats = prepare_sound(args, audio, about_patch(scene, args, kernel))
    write_prepared(sound)
    return stats


def write_prepared(sound: "PreparedSound") -> None:
    """Write a sound to its file, and print what there is to say of it. Raises CommandError."""
    write_file(sound.file.path, lambda path: sound.write())
    print_messages(sound.warnings)


def render_scene(scene: "Scene", args: argparse.Namespace, progress: Progress, **settings: Any) -> "Rendering":
    """Render a scene as the options say. settings: others of `fdh.render`. Raises BuildError, MemoryError."""
    from engine.api.rendering import render

    settings = {"cores": args.cores, "progress": progress, "kernel": args.kernel} | args.accuracy | settings
    return render(scene, args.seconds, samplerate_of(args), **settings)


def keep_interrupted(render: "Callable[[], R]") -> "tuple[R, bool]":
    """Render; or, at Ctrl-C, take what is rendered by then. Returns it, and whether it was interrupted. Raises
    KeyboardInterrupt if nothing is."""
    try:
        return render(), False
    except RenderInterrupted as stop:
        return stop.rendering, True


@dataclass(frozen=True)
class Rendered:
    """A rendering, or as much of it as Ctrl-C left."""

    rendering: "Rendering"
    estimate: "ErrorEstimate | None" = None
    is_interrupted: bool = False


def render_with_estimate(scene: "Scene", args: argparse.Namespace) -> Rendered:
    """Render a scene, and estimate its error; again with smaller errors in each sample, as long as the error is larger
    than the options ask for. Raises KeyboardInterrupt at Ctrl-C if nothing is rendered by then."""
    whole: list[Rendered] = []
    try:
        return _render_with_estimate(scene, args, whole)
    except KeyboardInterrupt as stop:
        if whole:  # it was estimated, or rendered again
            return Rendered(whole[-1].rendering, whole[-1].estimate, is_interrupted=True)
        if not isinstance(stop, RenderInterrupted):
            raise
        return Rendered(stop.rendering, is_interrupted=True)


def _render_with_estimate(scene: "Scene", args: argparse.Namespace, whole: list[Rendered]) -> Rendered:
    """The same, with all renderings up to now in a list. Raises KeyboardInterrupt at Ctrl-C."""
    from engine.patch.accuracy import SMALLEST_ERROR

    trace = any(given is not None for given in (args.trace, args.plot, args.report))
    settings = {"trace": trace, "trace_shapes": bool(args.trace_shapes)} | order_for_target(scene, args)
    before = math.inf, 0.0  # the last estimate, and its horizon
    for remaining in reversed(range(MAX_RENDERINGS)):
        with progress_feedback("rendering", describe_bodies(scene)) as progress:
            rendering = render_scene(scene, args, progress, **settings)
        whole.append(Rendered(rendering))
        estimate = None if math.isclose(rendering.stats.peak, 0.0) else estimate_for(scene, rendering, args)
        whole[-1] = Rendered(rendering, estimate)
        if args.target_error is None or estimate is None or remaining == 0 or estimate.horizon == 0.0:
            break
        is_stuck = estimate.motion > LEAST_GAIN * before[0] and estimate.horizon <= before[1]
        if estimate.motion <= args.target_error or is_stuck:
            break
        before = estimate.motion, estimate.horizon
        smaller = rendering.stats.accuracy["max_error"] * TARGETED_SHARE * args.target_error / estimate.motion
        settings["max_error"] = max(SMALLEST_ERROR, smaller)
    return whole[-1]


def order_for_target(scene: "Scene", args: argparse.Namespace) -> dict[str, int]:
    """Return the order that needs the least time for a small target error, unless the patch or an option gives one."""
    from engine.assembly.build import build
    from engine.patch.accuracy import ORDER_4_ERROR

    given = args.accuracy["order"] or scene.accuracy.model_fields_set & {"order"}
    if args.target_error is None or args.target_error > ORDER_4_ERROR or given:
        return {}
    try:
        build(scene, samplerate_of(args), scene.accuracy.replace(**args.accuracy | {"order": 4}))
    except BuildError:  # bodies with heavy damping need order 2
        return {}
    return {"order": 4}


def estimate_for(scene: "Scene", rendering: "Rendering", args: argparse.Namespace) -> "ErrorEstimate | None":
    """Estimate the error of a rendering if the options ask for it, or that of its beginning if the estimate costs
    little; None otherwise."""
    from engine.analysis.error_estimate import FINER_COST, estimate_error

    stats = rendering.stats
    settings = {"cores": stats.cores, "kernel": args.kernel}
    if args.error_estimate or args.target_error is not None:
        with progress_feedback("estimating the error") as progress:
            return estimate_error(scene, rendering, progress, **settings)
    settings["kernel"] = "general"  # a special one would have to be compiled
    cost = 0.0
    for part in ESTIMATED_PARTS:
        cost += stats.build_seconds + FINER_COST * part * stats.seconds / stats.real_time_factor
        if cost > ESTIMATE_SHARE * time.process_time():
            return None
        estimate = estimate_error(scene, rendering, seconds=part * stats.seconds, **settings)
        if estimate.motion > ROUNDING:
            return estimate
        if not stats.brief_contacts:
            return None
    return None


def render_from_arguments(
    scene: "Scene",
    args: argparse.Namespace,
    comparison: "WorkPrecisionStudy | None" = None,
    levels: "Callable[[np.ndarray], np.ndarray] | None" = None,
) -> Outputs:
    """Render a scene, with all that the options ask for beside its sound. Raises BuildError, MemoryError.

    comparison: what accuracy costs, for the page
    levels:     brings the sound of the file [frames, channels] to the volumes of a MIDI file
    """
    from engine.analysis.string_shape import string_shape

    text = "" if args.report is None else Path(args.patch).read_text("utf-8-sig")  # as it is rendered
    rendered = render_with_estimate(scene, args)
    rendering, estimate, is_interrupted = rendered.rendering, rendered.estimate, rendered.is_interrupted
    silence = rendering.silence
    audio = rendering.audio if levels is None else levels(rendering.audio)
    about = about_patch(scene, args, rendering.stats.kernel)
    sound, written = prepare_sound(args, audio, about, silence is not None)
    stats = rendering.stats.as_dict() | written | {"silent": silence}
    stats |= {"error_estimate": estimate and estimate.as_dict(), "target_error": args.target_error}
    stats |= {"interrupted": is_interrupted}
    warnings = [f"{args.patch}: silent; {silence}"] if silence else []
    warnings += [f"{args.patch}: {warning}" for warning in rendering.stats.warnings] + sound.warnings
    files: dict[Path, Callable[[Path], object]] = {sound.file.path: lambda path: sound.write()}
    if args.trace is not None:
        facts = {"patch": Path(args.patch).name, "patch_text": about.text, "kernel": about.kernel}
        facts["accuracy"] = json.dumps(rendering.stats.accuracy)
        files[args.trace] = partial(_write_trace, rendering, facts)
    if is_interrupted:
        asked = scene.seconds if args.seconds is None else args.seconds
        companions = {"--plot": args.plot, "--report": args.report, "--film": args.film}
        left_out = [option for option, given in companions.items() if given is not None]
        said = describe_interruption(rendering.audio, rendering.samplerate, asked, left_out)
        return Outputs(stats, [*warnings, said], is_interrupted, files)
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
            plot_rendering(rendering, title, path, shape, args.plot_style or "screen", plot_panels(args))

    if args.plot is not None:
        files[args.plot] = draw
    if args.report is not None:
        from engine.report.html import PageContents, compose_page

        profile = measure_profile(scene, rendering)
        with progress_feedback("drawing the page"):
            contents = PageContents(rendering, sound.audio, stats, profile, comparison, shape)
            shown = compose_page(title, text, contents)
        files[args.report] = lambda path: write_text(path, to_utf8_text(shown))
    if args.film is not None:
        files[args.film] = partial(_write_film, rendering, audio)
    return Outputs(stats, warnings, is_interrupted, files)


def _write_film(rendering: "Rendering", audio: "np.ndarray", path: Path) -> None:
    from engine.export.film import write_film

    write_film(path, rendering.scene, audio, rendering.samplerate, **rendering.stats.accuracy)


def _write_trace(rendering: "Rendering", facts: dict[str, str], path: Path) -> None:
    from engine.api.trace_files import write_trace

    if rendering.trace is not None:
        write_trace(path, rendering.trace, facts)


def describe_interruption(
    audio: "np.ndarray", samplerate: int, asked: float, left_out: list[str], patch: str = ""
) -> str:
    """Say what is written of a rendering that was interrupted, and what is not.

    audio:    what is rendered, [frames, channels]; asked: s, that were to be
    left_out: what is missing beside it: options, or patches of a mix
    patch:    of a mix, whose rendering it is; "" if there is no other
    """
    from engine.patch.frames import frame_count

    is_whole = len(audio) >= frame_count(asked, samplerate)
    part = "all" if is_whole else f"the first {len(audio) / samplerate:.3g} s"
    of_patch = f" of {patch}" if patch else ""
    without = f", without {join_with_or(left_out)}" if left_out else ""
    return f"interrupted; wrote {part} of {asked:g} s{of_patch}{without}"


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
