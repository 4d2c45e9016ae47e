"""The command line: arguments, progress, summary. Imports the engine late, so that --help and
errors answer at once."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.arguments import dial_of, error_of, misplaced, output_of, parser, plot_of, report_of, settings, unwritable
from engine.feedback import feedback, finite
from engine.save import amplified, replaced, save_audio, save_trace

if TYPE_CHECKING:
    import numpy as np

    from engine.offline import Take
    from engine.patch import Fault
    from engine.scene import Scene


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0, 1 (failed), 2 (bad input), 130 (Ctrl-C)."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        return check(words[1:]) if words[:1] == ["check"] else run(parser(), words)
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1


def run(parse: argparse.ArgumentParser, words: list[str]) -> int:
    """Do what the arguments say."""
    args = parse.parse_args(words)
    if args.list_devices:
        return devices()
    if args.replay:
        return replay(args)
    if args.patch is None:
        parse.error("give a PATCH, such as those in patches/")
    return varied(args) if args.vary else render(args)


def devices() -> int:
    """List what can be played on."""
    from engine.sound import SoundError, outputs

    try:
        found = outputs()
    except SoundError as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 1
    for number, name, channels, rate in found:
        print(f"{number:>3}  {name}: {channels} channels, {rate} Hz")
    if not found:
        print("no output device; rendering to a file needs none", file=sys.stderr)
    return 0 if found else 1


def replay(args: argparse.Namespace) -> int:
    """Render what was played live."""
    from engine.patch import Fault
    from engine.replay import replay as again

    faults = [Fault("render.py", None, option, what) for option, what in [*unwritable(args), *misplaced(args)]]
    output = output_of(args)
    try:
        log = json.loads(Path(args.replay).read_text("utf-8"))
        if not faults:
            with feedback(args.json):
                audio = again(log)
    except (OSError, ValueError, TypeError, IndexError, MemoryError) as error:
        why = str(error).splitlines()[0] if str(error) else "too long"
        faults.append(Fault(args.replay, None, "", f"cannot be read as a log ({why}); one that --log wrote"))
    if faults:
        report(faults)
        return 2
    try:
        save_audio(output, audio, log["samplerate"], args.subtype)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({error})", file=sys.stderr)
        return 1
    stats = {"output": str(output), "samplerate": log["samplerate"], "seconds": len(audio) / log["samplerate"]}
    print(json.dumps(stats) if args.json else output)
    return 0


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
    output = output_of(args)
    wrong += [*unwritable(args), *misplaced(args)]
    faults += [Fault("render.py", None, option, what) for option, what in wrong]
    if args.live:
        from engine import live

        faults += live.wrong(args)
    if scene is None or faults:
        report(faults)
        return 2
    if args.live:
        return played(scene, args, numbers["gain"])
    if args.midi:
        return noted(scene, numbers, args)

    from engine import tell
    from engine.build import BuildError
    from engine.offline import render as run

    try:
        if args.explain:
            return explain(scene, numbers, args)
        if args.price and args.report is None:
            return priced(scene, numbers, args)
        text = None if args.report is None else Path(args.patch).read_text("utf-8")  # as it is rendered
        found = measured(scene, numbers["seconds"], numbers, args) if args.price else None
        dial, chosen = dial_of(args), None
        if args.error is not None:
            dial, chosen = affordable(scene, numbers, args, dial)
        with feedback(args.json) as progress:
            take = run(
                scene,
                seconds=numbers["seconds"],
                samplerate=int(numbers["samplerate"] or 44_100),
                trace=any(given is not None for given in (args.trace, args.plot, args.report)),
                cores=None if numbers["cores"] is None else int(numbers["cores"]),
                progress=progress,
                **dial,
            )
        audio, gain = amplified(take.audio, float(take.stats["peak"]), numbers["gain"])
        told = {"patch": args.patch, "output": str(output), "peak": float(abs(audio).max()), "gain_db": gain}
        stats = take.stats | ({"chosen": chosen} if chosen else {}) | told
        page = None if text is None else paged(scene, text, take, audio, stats, found, args)
    except BuildError as error:
        report([Fault(args.patch, None, path, what) for path, what in error.faults])
        return 2
    except MemoryError:
        says = "not enough memory for so many samples; give fewer --seconds, or no --trace, --plot or --report"
        print(f"render.py: {says}", file=sys.stderr)
        return 1
    try:
        save_audio(output, audio, take.samplerate, args.subtype)
        names = beside(scene, take, page, found, args)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({error})", file=sys.stderr)
        return 1
    if args.json:
        print(json.dumps(finite(stats | ({"price": found} if found else {}))))
    else:
        if found:
            tell.priced(found)
        tell.summary(stats, names)
    return 0


def varied(args: argparse.Namespace) -> int:
    """Render variations of a patch."""
    from engine import sweep, tell, vary
    from engine.patch import Fault

    scene, faults = read(args.patch)
    numbers, wrong = settings(args)
    wrong += [*misplaced(args), *vary.unsuitable(args)]
    if scene is not None:
        plan, more = vary.plan(args, scene)
        wrong += more
    faults += [Fault("render.py", None, option, what) for option, what in wrong]
    if scene is None or faults:
        report(faults)
        return 2
    folder = vary.folder_of(args)
    try:
        with feedback(args.json) as progress:
            outcome = sweep.asked(plan, folder, numbers, dial_of(args), args.subtype, args.cluster, progress)
    except (OSError, RuntimeError) as error:
        why = f"cannot write to {folder} ({error})" if isinstance(error, OSError) else error
        print(f"render.py: {why}", file=sys.stderr)
        return 1
    print(json.dumps(outcome.told(folder))) if args.json else tell.varied(outcome.told(folder))
    return outcome.code


def paged(
    scene: "Scene",
    text: str,
    take: "Take",
    audio: "np.ndarray",
    stats: dict[str, Any],
    found: dict[str, Any] | None,
    args: argparse.Namespace,
) -> str:
    """The page of a render, whole before anything is written.

    text: of the patch; found: what accuracy costs, if it was asked
    """
    from engine.explain import explain as examine
    from engine.page import page

    accuracy = stats["accuracy"]
    with feedback(args.json) as progress:
        rate = take.samplerate * accuracy["oversample"]
        explained = examine(scene, stats["seconds"], rate, progress, **accuracy)
    return page(scene.title or Path(args.patch).stem, text, take, audio, stats, explained, found)


def beside(
    scene: "Scene", take: "Take", page: str | None, found: dict[str, Any] | None, args: argparse.Namespace
) -> list[str]:
    """Write what stands beside the sound: trace, picture and page; returns their names."""
    from engine import draw

    plot, html = plot_of(args), report_of(args)
    if args.trace and take.trace is not None:
        save_trace(Path(args.trace), take.trace)
    if plot is not None:
        with replaced(plot) as path:
            if found:
                draw.price(found, Path(args.patch).stem, path)
            else:
                draw.take(take, scene.title or Path(args.patch).stem, path)
    if html is not None and page is not None:
        with replaced(html) as path:
            path.write_text(page, "utf-8")
    return [str(path) for path in (args.trace, plot, html) if path]


def played(scene: "Scene", args: argparse.Namespace, gain: float | None) -> int:
    """Play a patch."""
    from engine import live
    from engine.build import BuildError
    from engine.patch import Fault
    from engine.sound import SoundError

    try:
        return live.play(args, scene, gain, dial_of(args))
    except SoundError as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 1
    except BuildError as error:
        report([Fault(args.patch, None, path, what) for path, what in error.faults])
        return 2


def noted(scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace) -> int:
    """Render the notes of a MIDI file."""
    from engine import midi
    from engine.build import BuildError

    rate, output = int(numbers["samplerate"] or 44_100), output_of(args)
    try:
        with feedback(args.json) as progress:
            audio, player = midi.render(scene, args.midi, rate, numbers["seconds"], int(args.voices), progress)
        audio, gain = amplified(audio, float(abs(audio).max()), numbers["gain"])
        save_audio(output, audio, rate, args.subtype)
    except (midi.MidiError, BuildError) as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 2
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({error})", file=sys.stderr)
        return 1
    now = player.meter()
    if args.json:
        stats = {"patch": args.patch, "output": str(output), "seconds": len(audio) / rate, "gain_db": gain, "live": now}
        print(json.dumps(finite(stats)))
    else:
        print(f"{len(audio) / rate:g} s, {player.voices} voices, energy error {now['energy_error']:.1e}\n{output}")
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
    from engine import draw, tell

    plot, found = plot_of(args), measured(scene, numbers["seconds"], numbers, args)
    if plot is not None:
        with replaced(plot) as path:
            draw.price(found, Path(args.patch).stem, path)
    if args.json:
        print(json.dumps({"patch": args.patch, "price": finite(found)}))
    else:
        tell.priced(found)
        if plot is not None:
            print(plot)
    return 0


def measured(
    scene: "Scene", seconds: float | None, numbers: dict[str, float | None], args: argparse.Namespace
) -> dict[str, Any]:
    """What accuracy costs (engine.price)."""
    from engine.price import price

    with feedback(args.json) as progress:
        return price(scene, seconds, int(numbers["samplerate"] or 44_100), progress)


def affordable(
    scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace, dial: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The cheapest setting that meets the error asked for, from a short pilot; and what is to be said of it."""
    from engine.price import choose

    amount, decibels = error_of(args.error)
    found = measured(scene, None, numbers, args)
    row, met = choose(found, amount, decibels)
    told = {key: row[key] for key in ("setting", "error", "bands_db", "ns_per_sample")}
    return dial | row["changes"], told | {"asked": args.error, "met": met, "horizon": found["horizon"]}
