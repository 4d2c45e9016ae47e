"""The command line: arguments, progress, summary. Imports the engine late, so that --help and
errors answer at once."""

import argparse
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from engine.offline import Take
    from engine.patch import Fault
    from engine.scene import Scene

LOUDNESS = -1.0  # dBFS, peak of a normalised file
SILENCE = 1e-30  # a smaller peak is not worth normalising
SUBTYPES = ("FLOAT", "PCM_24", "PCM_16", "DOUBLE")
PATIENCE = 1.5  # s, after which the user is told what takes so long

EXAMPLE = "patches/repelled_oscillator.toml"


def parser() -> argparse.ArgumentParser:
    """Arguments of a render. Numbers come as text, so that all that is wrong is said at once."""
    parse = argparse.ArgumentParser(
        prog="render.py",
        description="Render a patch to a WAV file. Energy-exact collisions; see README.md.",
        epilog=f"render.py check PATCH…   only validates patches.   Example: render.py {EXAMPLE} -o out.wav",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parse.add_argument("patch", metavar="PATCH", help="a TOML file, such as those in patches/")
    parse.add_argument("-o", "--output", metavar="OUT.wav", help="the file to write (default: the patch's name, here)")
    parse.add_argument("--seconds", metavar="S", help="length, s (default: what the patch says)")
    parse.add_argument("--samplerate", metavar="HZ", default="44100", help="sample rate, Hz (default: %(default)s)")
    parse.add_argument("--subtype", metavar="TYPE", help=f"sample format: {', '.join(SUBTYPES)} (default: FLOAT)")
    parse.add_argument("--gain", metavar="DB", help=f"fixed gain, dB, on SI units (default: peak at {LOUDNESS:g} dBFS)")
    dial = parse.add_argument_group("accuracy (default: what the patch says under [accuracy])")
    dial.add_argument("--scheme", metavar="NAME", help="exact: free vibration in tune; fdh: the paper's")
    dial.add_argument("--order", metavar="N", help="of a step: 2, 4 or 6")
    dial.add_argument("--substeps", metavar="N", help="steps per sample where contact is possible")
    dial.add_argument("--tolerance", metavar="T", help="relative error left in a compression")
    dial.add_argument("--oversample", metavar="N", help="compute all at a multiple of the sample rate")
    dial.add_argument("--precision", metavar="TYPE", help="of the modes: float64 or float32")
    parse.add_argument(
        "--cores", metavar="N", help="how many may share the work (default: all; the samples are the same)"
    )
    parse.add_argument(
        "--explain", action="store_true", help="what is built and left out, and what each island costs; writes no file"
    )
    parse.add_argument("--price", action="store_true", help="errors and costs at a ladder of settings; writes no sound")
    parse.add_argument("--plot", metavar="OUT.png", help="with --price: draw error against time")
    parse.add_argument(
        "--error", metavar="E", help="render at the cheapest setting that errs less: 1e-4, or 0.1dB of a band"
    )
    parse.add_argument("--trace", metavar="OUT.npz", help="also write every sample's displacements, forces, energies")
    parse.add_argument("--json", action="store_true", help="print the statistics as one JSON object")
    return parse


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0, 1 (failed), 2 (bad input), 130 (Ctrl-C)."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        return check(words[1:]) if words[:1] == ["check"] else render(parser().parse_args(words))
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1


def check(words: list[str]) -> int:
    """Validate patches without rendering."""
    parse = argparse.ArgumentParser(prog="render.py check", description="Validate patches without rendering.")
    parse.add_argument("patch", nargs="+", metavar="PATCH")
    faulty = False
    for path in parse.parse_args(words).patch:
        scene, faults = read(path)
        faulty = faulty or bool(faults)
        if scene is not None:
            parts = (len(scene.body), len(scene.contact), len(scene.force), len(scene.pickup))
            print(f"{path}: good; bodies {parts[0]}, contacts {parts[1]}, forces {parts[2]}, pickups {parts[3]}")
        report(faults)
    return 2 if faulty else 0


def read(path: str) -> "tuple[Scene | None, list[Fault]]":
    """A patch, or its faults."""
    from engine.patch import PatchError, load

    try:
        return load(path), []
    except PatchError as error:
        return None, error.faults


def report(faults: "list[Fault]") -> None:
    """One line each, on standard error."""
    for fault in faults:
        print(fault, file=sys.stderr)


def render(args: argparse.Namespace) -> int:
    """Render as the arguments say."""
    from engine.patch import Fault

    scene, faults = read(args.patch)
    numbers, wrong = settings(args)
    output = Path(args.output) if args.output else Path(Path(args.patch).stem + ".wav")
    wrong += unwritable(output, args)
    faults += [Fault("render.py", None, option, what) for option, what in wrong]
    if scene is None or faults:
        report(faults)
        return 2

    from engine import tell
    from engine.build import BuildError
    from engine.offline import render as run

    try:
        if args.explain:
            return explain(scene, numbers, args)
        if args.price:
            return priced(scene, numbers, args)
        dial, chosen = dial_of(args), None
        if args.error is not None:
            dial, chosen = affordable(scene, numbers, args, dial)
        with feedback(args.json) as progress:
            take = run(
                scene,
                seconds=numbers["seconds"],
                samplerate=int(numbers["samplerate"] or 44_100),
                trace=args.trace is not None,
                cores=None if numbers["cores"] is None else int(numbers["cores"]),
                progress=progress,
                **dial,
            )
    except BuildError as error:
        report([Fault(args.patch, None, path, what) for path, what in error.faults])
        return 2
    except MemoryError:
        print("render.py: not enough memory for so many samples; give fewer --seconds, or no --trace", file=sys.stderr)
        return 1
    try:
        audio, gain = amplify(take, numbers["gain"])
        save(output, args, take, audio)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({error})", file=sys.stderr)
        return 1
    peak = float(abs(audio).max())
    told = {"chosen": chosen} if chosen else {}
    stats = take.stats | told | {"patch": args.patch, "output": str(output), "peak": peak, "gain_db": gain}
    print(json.dumps(finite(stats))) if args.json else tell.summary(stats, args.trace)
    return 0


def explain(scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace) -> int:
    """Print what a scene is made of, and what it costs."""
    from engine import tell
    from engine.explain import explain as examine

    with feedback(args.json):
        seconds = numbers["seconds"] or scene.seconds
        found = examine(scene, seconds, int(numbers["samplerate"] or 44_100), **dial_of(args))
    if args.json:
        print(json.dumps({"patch": args.patch, "seconds": seconds, "explain": finite(found)}))
    else:
        tell.explained(found, seconds)
    return 0


def priced(scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace) -> int:
    """Print what accuracy costs, and draw it if asked."""
    from engine import tell
    from engine.price import price

    with feedback(args.json) as progress:
        found = price(scene, numbers["seconds"], int(numbers["samplerate"] or 44_100), progress)
    if args.plot:
        with replaced(Path(args.plot)) as path:
            tell.draw_price(found, Path(args.patch).stem, path)
    if args.json:
        print(json.dumps({"patch": args.patch, "price": finite(found)}))
    else:
        tell.priced(found)
        if args.plot:
            print(args.plot)
    return 0


def affordable(
    scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace, dial: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The cheapest setting that meets the error asked for, from a short pilot; and what is to be said of it."""
    from engine.price import choose, price

    amount, decibels = error_of(args.error)
    with feedback(args.json) as progress:
        found = price(scene, None, int(numbers["samplerate"] or 44_100), progress)
    row, met = choose(found, amount, decibels)
    measured = {key: row[key] for key in ("setting", "error", "bands_db", "ns_per_sample")}
    return dial | row["changes"], measured | {"asked": args.error, "met": met, "horizon": found["horizon"]}


def error_of(text: str) -> tuple[float, bool]:
    """An error asked for: 1e-4, or 0.1dB. Raises ValueError."""
    decibels = text.lower().endswith("db")
    amount = float(text[:-2] if decibels else text)
    if not 0.0 < amount < 100.0:
        raise ValueError(text)
    return amount, decibels


def finite(value: Any) -> Any:
    """The same with null for numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def settings(args: argparse.Namespace) -> tuple[dict[str, float | None], list[tuple[str, str]]]:
    """The numbers among the arguments, and what is wrong with the arguments."""
    from engine.parts import SECONDS
    from engine.scene import SAMPLERATES

    ranges = {"seconds": (0.0, SECONDS, "s"), "samplerate": (*SAMPLERATES, "Hz"), "gain": (-400.0, 400.0, "dB")}
    ranges["cores"] = (1, 1024, "cores")
    numbers: dict[str, float | None] = {}
    wrong: list[tuple[str, str]] = []
    for name, (low, high, unit) in ranges.items():
        text = getattr(args, name)
        right = f"{'more than 0' if name == 'seconds' else f'{low:g}'} to {high:g} {unit}"
        try:
            number = None if text is None else float(text)
        except ValueError:
            wrong.append((f"--{name}", f'"{text}" is not a number; {right}'))
            continue
        if number is not None and (not low <= number <= high or (name == "seconds" and number == 0)):
            wrong.append((f"--{name}", f"{text} is out of range; {right}"))
        elif name in ("samplerate", "cores") and number is not None and number != int(number):
            wrong.append((f"--{name}", f"{text} is not a whole number; {right}"))
        numbers[name] = number
    if args.error is not None:
        try:
            error_of(args.error)
        except ValueError:
            wrong.append(("--error", f'"{args.error}" is no error; a share as 1e-4, or decibels as 0.1dB'))
    if args.plot and not args.price:
        wrong.append(("--plot", "draws what --price measures; give --price too"))
    return numbers, wrong + undialled(args)


def dial_of(args: argparse.Namespace) -> dict[str, Any]:
    """The accuracy asked for, as numbers where it can be."""
    kinds = {"scheme": str, "order": int, "substeps": int, "tolerance": float, "oversample": int, "precision": str}
    asked: dict[str, Any] = {}
    for name, kind in kinds.items():
        text = getattr(args, name)
        try:
            asked[name] = None if text is None else kind(text)
        except ValueError:
            asked[name] = text
    return asked


def undialled(args: argparse.Namespace) -> list[tuple[str, str]]:
    """What is wrong with the accuracy asked for."""
    from engine.accuracy import Accuracy
    from engine.patch import wrong_value

    asked = {name: value for name, value in dial_of(args).items() if value is not None}
    found = ((name, wrong_value(Accuracy, name, value)) for name, value in asked.items())
    return [(f"--{name}", what) for name, what in found if what]


def unwritable(output: Path, args: argparse.Namespace) -> list[tuple[str, str]]:
    """What is wrong with the files to be written."""
    import soundfile

    wrong = []
    others = [("--trace", args.trace), ("--plot", args.plot)]
    for option, path in [("--output", output), *((name, Path(text)) for name, text in others if text)]:
        if not path.parent.is_dir():
            wrong.append((option, f"no such folder: {path.parent}; make it, or write elsewhere"))
        elif not os.access(path.parent, os.W_OK):
            wrong.append((option, f"{path.parent} cannot be written to; write elsewhere"))
        elif path.is_dir():
            wrong.append((option, f"{path} is a folder; give the name of a file"))
    kind = output.suffix.lstrip(".").upper()
    if kind not in soundfile.available_formats():
        wrong.append(("--output", f'"{output.name}" names no audio format; end it in .wav'))
    elif args.subtype is not None and args.subtype not in SUBTYPES:
        wrong.append(("--subtype", f'unknown sample format "{args.subtype}"; {", ".join(SUBTYPES)}'))
    elif not soundfile.check_format(kind, subtype_of(output, args)):
        wrong.append(("--subtype", f"{kind} files cannot hold {args.subtype}; write a .wav"))
    return wrong


def subtype_of(output: Path, args: argparse.Namespace) -> str | None:
    """The sample format asked for; FLOAT where a WAV is written, the format's own elsewhere."""
    subtype: str | None = args.subtype
    return subtype or ("FLOAT" if output.suffix.lower() == ".wav" else None)


@contextmanager
def feedback(quiet: bool) -> Iterator[Callable[[float], None]]:
    """Tell the user what takes so long: compiling, before the first samples; then a progress bar,
    on a terminal, once a render has lasted a while. Yields the function to call with the share done."""
    begin = time.perf_counter()
    say = "compiling the kernel for this kind of scene (once per machine) …"
    compiling = threading.Timer(PATIENCE, lambda: print(say, file=sys.stderr))
    compiling.daemon = True
    compiling.start()
    shown: list[Any] = []
    interrupted: list[int] = []

    def interrupt(number: int, frame: Any) -> None:
        interrupted.append(number)
        raise KeyboardInterrupt

    before = None
    if threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGINT, interrupt)

    def progress(share: float) -> None:
        compiling.cancel()
        if interrupted:  # while compiling, and lost in a callback of the compiler's
            raise KeyboardInterrupt
        late = time.perf_counter() - begin > PATIENCE and share < 0.9
        if not shown and late and sys.stderr.isatty() and not quiet:
            from rich.console import Console
            from rich.progress import Progress

            shown.append(Progress(console=Console(stderr=True), transient=True))
            shown[0].start()
            shown[0].add_task("rendering", total=1.0)
        if shown:
            shown[0].update(shown[0].task_ids[0], completed=share)

    try:
        yield progress
    finally:
        compiling.cancel()
        if before is not None:
            signal.signal(signal.SIGINT, before)
        if shown:
            shown[0].stop()


def amplify(take: "Take", gain: float | None) -> "tuple[np.ndarray, float]":
    """The audio at the level of the file, and its gain in dB."""
    import numpy as np

    peak = float(take.stats["peak"])
    if gain is None:
        gain = LOUDNESS - 20 * math.log10(peak) if peak > SILENCE else 0.0
    return np.asarray(take.audio * 10 ** (gain / 20)), gain


def save(output: Path, args: argparse.Namespace, take: "Take", audio: "np.ndarray") -> None:
    """Write the files beside their targets, then rename: no target is ever half-written."""
    import numpy as np
    import soundfile

    kind = output.suffix.lstrip(".").upper()
    with replaced(output) as path:
        soundfile.write(path, audio, take.samplerate, format=kind, subtype=subtype_of(output, args))
    if args.trace and take.trace is not None:
        with replaced(Path(args.trace)) as path, open(path, "wb") as file:
            np.savez(file, **take.trace)  # type: ignore[arg-type]


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """A temporary file beside the target, which takes its place when all is written."""
    path = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        yield path
        os.replace(path, target)
    finally:
        path.unlink(missing_ok=True)
