"""A rendering with its files: everything is computed first, and then the sound and its companions are written."""

import argparse
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.cli.messages import describe_bodies
from engine.cli.option_checks import (
    NumericOptions,
    accuracy_options,
    optional_path,
    parse_error_target,
    plot_path,
    report_path,
    samplerate_of,
    sound_path,
)
from engine.cli.progress import progress_feedback
from engine.output_files import (
    apply_gain,
    atomic_write,
    count_clipped,
    describe_lowered_gain,
    error_reason,
    save_audio,
    save_trace,
    to_utf8_text,
)

if TYPE_CHECKING:
    import numpy as np

    from engine.analysis.string_shape import StringShape
    from engine.analysis.work_precision import WorkPrecisionStudy
    from engine.offline.render import Rendering
    from engine.patch.scene import Scene

CHOSEN_SETTING_KEYS = ("setting", "error", "bands_db", "ns_per_sample")


@dataclass(frozen=True)
class Outputs:
    """A rendering, and all that is to be written and printed of it."""

    title: str
    rendering: "Rendering"
    audio: "np.ndarray"  # as the file will have it
    stats: dict[str, Any]  # as `--json` prints them: of the rendering, and of the file
    comparison: "WorkPrecisionStudy | None"  # of accuracy settings, if an option needs it
    page: str | None  # likewise
    shape: "StringShape | None"  # of the string that moves first, for the pictures
    warnings: list[str]


class WriteError(RuntimeError):
    """A file could not be written."""


def render_from_arguments(
    scene: "Scene", numbers: NumericOptions, args: argparse.Namespace, comparison: "WorkPrecisionStudy | None" = None
) -> Outputs:
    """Render a scene as the options say. Raises BuildError, MemoryError.

    comparison: what accuracy costs, for the page
    """
    from engine.analysis.error_estimate import estimate_error
    from engine.analysis.silence import explain_silence
    from engine.analysis.string_shape import string_shape
    from engine.offline.render import render

    text = None if args.report is None else Path(args.patch).read_text("utf-8-sig")  # as it is rendered
    accuracy, chosen = accuracy_options(args), dict[str, Any]()
    if args.target_error is not None:
        accuracy, chosen = cheapest_setting(scene, numbers, args, accuracy)
    with progress_feedback("rendering", describe_bodies(scene)) as progress:
        rendering = render(
            scene,
            seconds=numbers["seconds"],
            samplerate=samplerate_of(numbers),
            trace=any(given is not None for given in (args.trace, args.plot, args.report)),
            cores=None if numbers["cores"] is None else int(numbers["cores"]),
            progress=progress,
            kernel=args.kernel,
            trace_shapes=bool(args.trace_shapes),
            **accuracy,
        )
    estimate = None
    if args.error_estimate and not math.isclose(rendering.stats.peak, 0.0):
        with progress_feedback("estimating the error") as progress:
            estimate = estimate_error(scene, rendering, progress, cores=rendering.stats.cores, kernel=args.kernel)
    output, stats = sound_path(args), rendering.stats
    silence = explain_silence(scene, stats.seconds, stats.samplerate, stats.peak, stats)
    audio, gain = apply_gain(rendering.audio, 0.0 if silence else stats.peak, numbers["gain"], args.subtype)
    cut = count_clipped(output, audio, gain, args.subtype)
    printed = stats.as_dict()
    printed |= {"patch": args.patch, "output": str(output), "peak": float(abs(audio).max()), "gain_db": gain}
    printed |= {"error_estimate": estimate.as_dict()} if estimate is not None else {}
    printed |= {"silent": silence, "clipped": cut.count if cut else 0} | ({"chosen": chosen} if chosen else {})
    warnings = [f"{args.patch}: silent; {silence}"] if silence else []
    warnings += [f"{args.patch}: {warning}" for warning in stats.warnings]
    warnings += describe_lowered_gain(output, gain, numbers["gain"])
    warnings += [f"{output}: {cut}"] if cut else []
    title = scene.title or Path(args.patch).stem
    shape = None
    if (args.plot is not None and comparison is None) or args.report is not None:
        with progress_feedback("computing the shape of a string"):
            shape = string_shape(scene, rendering)
    outputs = Outputs(title, rendering, audio, printed, comparison, None, shape, warnings)
    return outputs if text is None else replace(outputs, page=html_report(scene, text, outputs, args))


def html_report(scene: "Scene", text: str, outputs: Outputs, args: argparse.Namespace) -> str:
    """The page of a rendering, whole before anything is written. text: of the patch."""
    from engine.analysis.profile import profile_scene
    from engine.report.html import compose_page

    accuracy = outputs.stats["accuracy"]
    with progress_feedback("measuring costs") as progress:
        rate = outputs.rendering.samplerate * accuracy["oversample"]
        explained = profile_scene(scene, outputs.stats["seconds"], rate, progress, **accuracy)
    with progress_feedback("drawing the page"):
        return compose_page(
            outputs.title,
            text,
            outputs.rendering,
            outputs.audio,
            outputs.stats,
            explained,
            outputs.comparison,
            outputs.shape,
        )


def write_outputs(outputs: Outputs, args: argparse.Namespace) -> list[Path]:
    """Write the sound and its companions: trace, picture and page; returns the names of these. Raises WriteError."""

    def picture(path: Path) -> None:
        from engine.report import plots, work_precision_plot

        style = args.plot_style or "screen"
        if outputs.comparison is not None:
            work_precision_plot.plot_work_precision(outputs.comparison, Path(args.patch).stem, path, style)
        else:
            plots.plot_rendering(outputs.rendering, outputs.title, path, outputs.shape, style)

    def sound(path: Path) -> None:
        save_audio(path, outputs.audio, outputs.rendering.samplerate, args.subtype)

    def write_page(path: Path) -> None:
        with atomic_write(path) as part:
            part.write_text(page, "utf-8")

    trace: Mapping[str, object] = outputs.rendering.trace or {}
    page = to_utf8_text(outputs.page or "")
    companions: list[tuple[Path | None, Callable[[Path], object]]] = [
        (optional_path(args.trace), lambda path: save_trace(path, trace)),
        (plot_path(args), picture),
        (report_path(args), write_page),
    ]
    with progress_feedback("writing the files"):
        write_or_raise(sound_path(args), sound)
        for target, job in companions:
            if target is not None:
                write_or_raise(target, job)
    return [target for target, _ in companions if target is not None]


def write_or_raise(target: Path, job: Callable[[Path], object]) -> None:
    """Let a job write a file. Raises WriteError, which says which and why."""
    try:
        job(target)
    except (OSError, RuntimeError) as error:
        raise WriteError(f"cannot write {target} ({error_reason(error)})") from error


def run_work_precision(
    scene: "Scene", seconds: float | None, numbers: NumericOptions, args: argparse.Namespace
) -> "WorkPrecisionStudy":
    """Measure what accuracy costs (engine.analysis.work_precision)."""
    from engine.analysis.work_precision import measure_work_precision

    with progress_feedback("comparing settings") as progress:
        return measure_work_precision(scene, seconds, samplerate_of(numbers), progress)


def cheapest_setting(
    scene: "Scene", numbers: NumericOptions, args: argparse.Namespace, accuracy: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Choose the cheapest setting that meets the target error, by a short study; return it with its statistics."""
    from engine.analysis.work_precision import cheapest_within

    amount, decibels = parse_error_target(args.target_error)
    study = run_work_precision(scene, None, numbers, args)
    target = {"asked": args.target_error, "horizon": study["horizon"], "unmeasured": study["unmeasured"]}
    if study["unmeasured"]:
        return accuracy, dict.fromkeys(CHOSEN_SETTING_KEYS) | target | {"met": False}
    row, met = cheapest_within(study, amount, decibels)
    return accuracy | row["changes"], {key: row[key] for key in CHOSEN_SETTING_KEYS} | target | {"met": met}
