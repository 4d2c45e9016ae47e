"""The command line: arguments, progress, summary. Imports the engine late, so that --help and
errors answer at once."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine import commands
from engine.arguments import dial_of, error_of, misplaced, output_of, parser, plot_of, settings, unwritable
from engine.commands import read, report
from engine.feedback import feedback, finite
from engine.save import amplified, clipped, reason, replaced, save_audio, save_trace

if TYPE_CHECKING:
    from engine.scene import Scene

COMMANDS = {
    "check": commands.check,
    "new": commands.new,
    "params": commands.params,
    "reference": commands.reference,
    "schema": commands.schema,
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0, 1 (failed), 2 (bad input), 130 (Ctrl-C)."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        if words and words[0] in COMMANDS:
            return COMMANDS[words[0]](words[1:])
        if words and (meant := commands.misspelt(words[0], list(COMMANDS))):
            print(f'render.py: no command or file "{words[0]}"; did you mean "{meant}"?', file=sys.stderr)
            return 2
        return run(parser(), words)
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
        parse.error("give a PATCH, such as those in patches/, or start one with render.py new NAME")
    return render(args)


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
        why = reason(error).splitlines()[0] if str(error) else "too long"
        faults.append(Fault(args.replay, None, "", f"cannot be read as a log ({why}); one that --log wrote"))
    if faults:
        report(faults)
        return 2
    try:
        save_audio(output, audio, log["samplerate"], args.subtype)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({reason(error)})", file=sys.stderr)
        return 1
    stats = {"output": str(output), "samplerate": log["samplerate"], "seconds": len(audio) / log["samplerate"]}
    print(json.dumps(stats) if args.json else output)
    return 0


def render(args: argparse.Namespace) -> int:
    """Render as the arguments say."""
    from engine.patch import Fault

    scene, faults = read(args.patch)
    numbers, wrong = settings(args)
    output, plot = output_of(args), plot_of(args)
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

    from engine import draw, tell
    from engine.build import BuildError
    from engine.offline import render as run
    from engine.silence import why

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
                trace=args.trace is not None or plot is not None,
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
    silent, target = why(scene, take.stats), output
    audio, gain = amplified(take.audio, 0.0 if silent else float(take.stats["peak"]), numbers["gain"])
    try:
        save_audio(output, audio, take.samplerate, args.subtype)
        if args.trace and take.trace is not None:
            target = Path(args.trace)
            save_trace(target, take.trace)
        if plot is not None:
            target = plot
            with replaced(plot) as path:
                draw.take(take, scene.title or Path(args.patch).stem, path)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {target} ({reason(error)})", file=sys.stderr)
        return 1
    peak, cut = float(abs(audio).max()), clipped(output, audio, gain, args.subtype)
    if silent:
        print(f"{args.patch}: silent; {silent}", file=sys.stderr)
    if cut:
        print(f"{output}: {cut}", file=sys.stderr)
    told = {"silent": silent, "clipped": cut.count if cut else 0} | ({"chosen": chosen} if chosen else {})
    stats = take.stats | told | {"patch": args.patch, "output": str(output), "peak": peak, "gain_db": gain}
    print(json.dumps(finite(stats))) if args.json else tell.summary(
        stats, [str(path) for path in (args.trace, plot) if path]
    )
    return 0


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
    except OSError as error:
        print(f"render.py: cannot write what was played ({reason(error)})", file=sys.stderr)
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
        print(f"render.py: cannot write {output} ({reason(error)})", file=sys.stderr)
        return 1
    if cut := clipped(output, audio, gain, args.subtype):
        print(f"{output}: {cut}", file=sys.stderr)
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
    from engine.price import price

    plot = plot_of(args)
    with feedback(args.json) as progress:
        found = price(scene, numbers["seconds"], int(numbers["samplerate"] or 44_100), progress)
    try:
        if plot is not None:
            with replaced(plot) as path:
                draw.price(found, Path(args.patch).stem, path)
    except OSError as error:
        print(f"render.py: cannot write {plot} ({reason(error)})", file=sys.stderr)
        return 1
    if args.json:
        print(json.dumps({"patch": args.patch, "price": finite(found)}))
    else:
        tell.priced(found)
        if plot is not None:
            print(plot)
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
