"""One render as the command line asks for it: computed first, all of it, then written with what stands beside it."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.arguments import dial_of, error_of, output_of, plot_of, report_of
from engine.feedback import feedback
from engine.save import amplified, clipped, lowered, plain, reason, replaced, save_audio, save_trace

if TYPE_CHECKING:
    import numpy as np

    from engine.offline import Take
    from engine.scene import Scene

Numbers = dict[str, float | None]  # those among the arguments
TOLD = ("setting", "error", "bands_db", "ns_per_sample")  # of the setting that is chosen


@dataclass(frozen=True)
class Rendering:
    """What was computed."""

    title: str
    take: "Take"
    audio: "np.ndarray"  # as the file will have it
    stats: dict[str, Any]  # of the take, and of the file
    price: dict[str, Any] | None  # what accuracy costs, if that was asked
    page: str | None  # likewise
    warnings: list[str]


class Unwritten(RuntimeError):
    """A file could not be written."""


def rendering(scene: "Scene", numbers: Numbers, args: argparse.Namespace) -> Rendering:
    """Render a scene. Raises BuildError, MemoryError."""
    from engine.offline import render
    from engine.silence import why

    text = None if args.report is None else Path(args.patch).read_text("utf-8-sig")  # as it is rendered
    price = measured(scene, numbers["seconds"], numbers, args) if args.price else None
    dial, chosen = dial_of(args), dict[str, Any]()
    if args.error is not None:
        dial, chosen = affordable(scene, numbers, args, dial)
    with feedback(args.json) as progress:
        take = render(
            scene,
            seconds=numbers["seconds"],
            samplerate=int(numbers["samplerate"] or 44_100),
            trace=any(given is not None for given in (args.trace, args.plot, args.report)),
            cores=None if numbers["cores"] is None else int(numbers["cores"]),
            progress=progress,
            **dial,
        )
    output, silent = output_of(args), why(scene, take.stats)
    audio, gain = amplified(take.audio, 0.0 if silent else float(take.stats["peak"]), numbers["gain"], args.subtype)
    cut = clipped(output, audio, gain, args.subtype)
    told = {"patch": args.patch, "output": str(output), "peak": float(abs(audio).max()), "gain_db": gain}
    told |= {"silent": silent, "clipped": cut.count if cut else 0} | ({"chosen": chosen} if chosen else {})
    stats, title = take.stats | told, scene.title or Path(args.patch).stem
    warnings = [f"{args.patch}: silent; {silent}"] if silent else []
    warnings += [f"{args.patch}: {warning}" for warning in take.stats["warnings"]]
    warnings += lowered(output, gain, numbers["gain"])
    warnings += [f"{output}: {cut}"] if cut else []
    made = Rendering(title, take, audio, stats, price, None, warnings)
    return made if text is None else replace(made, page=paged(scene, text, made, args))


def paged(scene: "Scene", text: str, made: Rendering, args: argparse.Namespace) -> str:
    """The page of a render, whole before anything is written. text: of the patch."""
    from engine.explain import explain
    from engine.page import page

    accuracy = made.stats["accuracy"]
    with feedback(args.json) as progress:
        rate = made.take.samplerate * accuracy["oversample"]
        explained = explain(scene, made.stats["seconds"], rate, progress, **accuracy)
    return page(made.title, text, made.take, made.audio, made.stats, explained, made.price)


def write(made: Rendering, args: argparse.Namespace) -> list[Path]:
    """Write the sound, and trace, picture and page beside it; returns the names of these. Raises Unwritten."""
    from engine import draw

    def picture(path: Path) -> None:
        if made.price is not None:
            draw.price(made.price, Path(args.patch).stem, path)
        else:
            draw.take(made.take, made.title, path)

    written(output_of(args), lambda path: save_audio(path, made.audio, made.take.samplerate, args.subtype))
    trace, page = made.take.trace or {}, plain(made.page or "")
    beside: list[tuple[Path | None, Callable[[Path], object]]] = [
        (Path(args.trace) if args.trace else None, lambda path: save_trace(path, trace)),
        (plot_of(args), lambda path: inside(path, picture)),
        (report_of(args), lambda path: inside(path, lambda part: part.write_text(page, "utf-8"))),
    ]
    for target, job in beside:
        if target is not None:
            written(target, job)
    return [target for target, _ in beside if target is not None]


def inside(target: Path, job: Callable[[Path], object]) -> None:
    """Let a job write beside a target, and take its place."""
    with replaced(target) as part:
        job(part)


def written(target: Path, job: Callable[[Path], object]) -> None:
    """Let a job write a file. Raises Unwritten, which says which and why."""
    try:
        job(target)
    except (OSError, RuntimeError) as error:
        raise Unwritten(f"cannot write {target} ({reason(error)})") from error


def measured(scene: "Scene", seconds: float | None, numbers: Numbers, args: argparse.Namespace) -> dict[str, Any]:
    """What accuracy costs (engine.price)."""
    from engine.price import price

    with feedback(args.json) as progress:
        return price(scene, seconds, int(numbers["samplerate"] or 44_100), progress)


def affordable(
    scene: "Scene", numbers: Numbers, args: argparse.Namespace, dial: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The cheapest setting that meets the error asked for, from a short pilot; and what is to be said of it."""
    from engine.price import choose

    amount, decibels = error_of(args.error)
    found = measured(scene, None, numbers, args)
    asked = {"asked": args.error, "horizon": found["horizon"], "unmeasured": found["unmeasured"]}
    if found["unmeasured"]:
        return dial, dict.fromkeys(TOLD) | asked | {"met": False}
    row, met = choose(found, amount, decibels)
    return dial | row["changes"], {key: row[key] for key in TOLD} | asked | {"met": met}
