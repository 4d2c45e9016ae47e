"""The command line: arguments, progress, summary. Imports the engine late, so that --help and
errors answer at once."""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from engine import commands, leftovers, streams
from engine.arguments import dial_of, misplaced, output_of, parser, plot_of, settings, unheld, unwritable
from engine.commands import read, report
from engine.feedback import feedback, finite
from engine.save import amplified, clipped, lowered, reason, save_audio

if TYPE_CHECKING:
    from engine.scene import Scene

COMMANDS = {
    "cache": commands.cache,
    "check": commands.check,
    "new": commands.new,
    "params": commands.params,
    "recover": leftovers.recover,
    "reference": commands.reference,
    "schema": commands.schema,
}


def program() -> int:
    """Run the command line as a program of its own, whatever its standard streams are; returns the exit code."""
    streams.prepare()
    try:
        code = main()
    except SystemExit as end:  # of argparse
        code = end.code if isinstance(end.code, int) else 0
    return streams.finish(code)


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


def run(parse: argparse.ArgumentParser, words: list[str]) -> int:
    """Do what the arguments say."""
    args = parse.parse_args(words)
    if args.list_devices:
        return devices()
    if args.replay:
        return replay(args)
    if args.patch is None:
        parse.error("give a PATCH, such as those in patches/, or start one with render.py new NAME")
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
    from engine.replay import read as opened
    from engine.replay import replay as again

    faults = [Fault("render.py", None, option, what) for option, what in [*unwritable(args), *misplaced(args)]]
    output = output_of(args)
    try:
        log = opened(Path(args.replay))
        wrong = unheld(args, log.samplerate, max(p.channel for p in log.made().pickup))
        faults += [Fault("render.py", None, option, what) for option, what in wrong]
        if not faults:
            with feedback(args.json):
                audio = again(log)
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        why = reason(error).splitlines()[0] if str(error) else "too long"
        faults.append(Fault(args.replay, None, "", f"cannot be read as a log ({why}); one that --log wrote"))
    if faults:
        report(faults)
        return 2
    try:
        save_audio(output, audio, log.samplerate, args.subtype)
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({reason(error)})", file=sys.stderr)
        return 1
    stats = {"output": str(output), "samplerate": log.samplerate, "seconds": len(audio) / log.samplerate}
    print(json.dumps(stats) if args.json else output)
    return 0


def render(args: argparse.Namespace) -> int:
    """Render as the arguments say."""
    from engine.patch import Fault, located

    scene, faults = read(args.patch)
    numbers, wrong = settings(args)
    wrong += [*unwritable(args), *misplaced(args)]
    if scene is not None and not wrong and not (args.live and args.samplerate is None):  # which is the device's own
        wrong += unheld(args, int(numbers["samplerate"] or 44_100), max(p.channel for p in scene.pickup))
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

    from engine import once, tell
    from engine.build import BuildError

    try:
        if args.explain:
            return explain(scene, numbers, args)
        if args.price and args.report is None:
            return priced(scene, numbers, args)
        made = once.rendering(scene, numbers, args)
        beside = once.write(made, args)
    except BuildError as error:
        report(located(args.patch, error.faults))
        return 2
    except MemoryError:
        says = "not enough memory for so many samples; give fewer --seconds, or no --trace, --plot or --report"
        print(f"render.py: {says}", file=sys.stderr)
        return 1
    except once.Unwritten as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 1
    for warning in made.warnings:
        print(warning, file=sys.stderr)
    if args.json:
        print(json.dumps(finite(made.stats | ({"price": made.price} if made.price else {}))))
        return 0
    if made.price:
        tell.priced(made.price)
    tell.summary(made.stats, [str(path) for path in beside])
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
        why = f"cannot write to {folder} ({reason(error)})" if isinstance(error, OSError) else error
        print(f"render.py: {why}", file=sys.stderr)
        return 1
    print(json.dumps(outcome.told(folder))) if args.json else tell.varied(outcome.told(folder))
    return outcome.code


def played(scene: "Scene", args: argparse.Namespace, gain: float | None) -> int:
    """Play a patch."""
    from engine import live
    from engine.build import BuildError
    from engine.patch import located
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
        report(located(args.patch, error.faults))
        return 2


def noted(scene: "Scene", numbers: dict[str, float | None], args: argparse.Namespace) -> int:
    """Render the notes of a MIDI file."""
    from engine import limits, midi
    from engine.build import BuildError
    from engine.doubts import doubts
    from engine.patch import located

    rate, output = int(numbers["samplerate"] or 44_100), output_of(args)
    try:
        limits.bodies(scene, rate, scene.accuracy.scheme)
        with feedback(args.json) as progress:
            audio, player, played = midi.render(scene, args.midi, rate, numbers["seconds"], int(args.voices), progress)
        audio, gain = amplified(audio, float(abs(audio).max()), numbers["gain"], args.subtype)
        save_audio(output, audio, rate, args.subtype)
    except midi.MidiError as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 2
    except BuildError as error:
        report(located(args.patch, error.faults))
        return 2
    except MemoryError:
        print("render.py: not enough memory for so many samples; give fewer --seconds or --voices", file=sys.stderr)
        return 1
    except (OSError, RuntimeError) as error:
        print(f"render.py: cannot write {output} ({reason(error)})", file=sys.stderr)
        return 1
    if cut := clipped(output, audio, gain, args.subtype):
        print(f"{output}: {cut}", file=sys.stderr)
    for warning in lowered(output, gain, numbers["gain"]):
        print(warning, file=sys.stderr)
    now = player.meter()
    reasons = doubts(now["newton"], {"error_max": now["energy_error"]}, not now["not_finite"])
    if args.json:
        stats = {"patch": args.patch, "output": str(output), "seconds": len(audio) / rate, "gain_db": gain, "live": now}
        stats |= {"notes": played, "trusted": not reasons, "reasons": reasons}
        print(json.dumps(finite(stats)))
    else:
        for body, notes in played.items():
            print(f"{body} plays {notes}")
        for why in reasons:
            print(f"NOT TO BE TRUSTED: {why}")
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
    from engine import draw, once, tell

    plot, found = plot_of(args), once.measured(scene, numbers["seconds"], numbers, args)
    if plot is not None:
        once.written(plot, lambda path: once.inside(path, lambda part: draw.price(found, Path(args.patch).stem, part)))
    if args.json:
        print(json.dumps({"patch": args.patch, "price": finite(found)}))
    else:
        tell.priced(found)
        if plot is not None:
            print(plot)
    return 0
