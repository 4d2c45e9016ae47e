"""Live sound from the command line: play a patch, with keys, a meter and a recording."""

import argparse
import json
import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine import deck, midi, sound
from engine.patch import Fault
from engine.player import Player
from engine.reload import Watch
from engine.save import replaced
from engine.scene import Scene

TICK = 0.004  # s, between two looks at notes …
REST = 0.1  # s, … and at the meter and the patch's file
PILOT = 1.0  # s of a patch that are measured before it is played
HEADROOM = 0.5  # peak of the pilot in the output: what is struck later may be louder
PATIENCE = 2.0  # s, for the driver to end
SOFTEST = 0.2  # of a hammer's own speed, for key 1; key 5 is as the patch has it
ENDS = {"q": "quit", "n": "next"}
KEYS = "keys: space strike, 1 to 9 softer to harder, m mute, n next patch, q quit"


class TooHeavy(RuntimeError):
    """A patch that is not computed as fast as it sounds."""


def pilot(player: Player, block: int) -> tuple[float, float]:
    """Times real time that the dearest stretch of a patch's beginning runs at, and the patch's peak, in SI units."""
    if player.voices:
        player.strike()
    samplerate = player.samplerate
    out, slowest = np.zeros((block, player.channels), np.float32), math.inf
    span, spent, played = 8 * block, 0.0, 0
    while player.frame < PILOT * samplerate and not player.over:
        begin = time.perf_counter()
        player.play(out)
        spent, played = spent + time.perf_counter() - begin, played + block
        if played >= span:
            slowest, spent, played = min(slowest, played / samplerate / spent), 0.0, 0
    return slowest, float(player.gauge[deck.PEAK])


def ready(scene: Scene, samplerate: int, args: argparse.Namespace, gain: float | None) -> Player:
    """A player at a good level. Raises TooHeavy unless told to play all the same, MidiError."""
    many: dict[str, Any] = {}
    seconds = None if args.seconds is None else float(args.seconds)
    if args.midi:
        many = {"voices": int(args.voices), "lowest": midi.lowest(args.midi, scene)}
        seconds = math.inf if seconds is None else seconds
    speed, peak = pilot(Player(scene, samplerate, **many), int(args.block))
    if speed < 1.0 and not args.force:
        raise TooHeavy(
            f"too heavy for real time: {speed:.2f} × at its busiest; fewer modes or points of contact, a lower"
            " --samplerate, or --force"
        )
    factor = 10 ** (gain / 20) if gain is not None else HEADROOM / peak if peak > 0.0 else 1.0
    return Player(scene, samplerate, seconds, factor, **many)


def play(args: argparse.Namespace, scene: Scene, gain: float | None) -> int:
    """Play a patch, and those after it if asked; returns the exit code."""
    path = Path(args.patch)
    while True:
        try:
            _, name, _, own = sound.output(args.device)
            samplerate = own if args.samplerate is None else int(float(args.samplerate))
            player = ready(scene, samplerate, args, gain)
            stream = sound.stream(
                player, args.device, int(args.block), latency(args.latency), args.callback != "python"
            )
            notes = midi.source(args.midi, midi.Keys(player)) if args.midi else None
        except (sound.SoundError, midi.MidiError, TooHeavy) as error:
            print(f"render.py: {error}", file=sys.stderr)
            return 1
        print(f"{scene.title or path.stem}, on {name} at {samplerate} Hz, blocks of {args.block}", flush=True)
        wish = "vanished"
        with recording(args.record, player) as write, keyboard() as keys, meter() as show:
            make = partial(ready, samplerate=samplerate, args=args, gain=gain)
            watch = Watch(path, scene, player, make) if args.watch else None
            stream.start()
            wish = attend(player, stream, write, keys, show, watch, notes)
        if wish == "vanished":
            print(f"render.py: {name} is gone; what was recorded is kept", file=sys.stderr)
            sound.forget()
            sys.stderr.flush()
            os._exit(1)  # PortAudio would wait for a device that does not answer
        stream.close()
        tell(watch.player if watch is not None else player, args)
        if wish != "next":
            return 130 if wish == "interrupted" else 0
        path, scene = following(path)


def latency(text: str | None) -> str | float | None:
    """What sounddevice takes: low, high, or seconds."""
    return text if text in (None, "low", "high") else float(text)


def attend(
    first: Player, stream: Any, write: Any, keys: Any, show: Any, watch: Watch | None, notes: midi.Source | None
) -> str:
    """Keys, meter and recording while the driver plays; returns how it ended."""
    wish, deadline, player, shown = "over", math.inf, first, -math.inf
    with interrupts() as interrupted:
        while True:
            key = keys(TICK if notes is not None else REST)
            if notes is not None and notes():
                player.stop()
            if time.monotonic() - shown >= REST:
                shown = time.monotonic()
                write(first.fetch())
                if watch is not None:
                    for line in watch.look():
                        print(line, file=sys.stderr)
                    player = watch.player
                show(player)
            if wish == "over" and (interrupted or key in ENDS):
                wish = "interrupted" if interrupted else ENDS[key]
                player.stop()
                deadline = time.monotonic() + PATIENCE
            elif key is not None:
                press(player, key)
            if not stream.active:
                write(first.fetch())
                return wish if first.over else "vanished"
            if time.monotonic() > deadline:
                return "vanished"


def press(player: Player, key: str) -> None:
    """What a key does."""
    if key == "m":
        player.damp()
    elif key in (" ", "s"):
        player.strike()
    elif key in "123456789":
        for hammer in player.hammers:
            player.strike(hammer, SOFTEST * int(key) * player.speed(hammer))


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """A list that holds something once Ctrl-C was pressed: nothing is broken off half-way."""
    found: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: found.append(number))
    try:
        yield found
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def recording(target: str | None, player: Player) -> Iterator[Any]:
    """A function that writes samples to a file, which takes its name when all is written."""
    if target is None:
        yield lambda samples: None
        return
    import soundfile

    kind = Path(target).suffix.lstrip(".").upper()
    with (
        replaced(Path(target)) as path,
        soundfile.SoundFile(path, "w", player.samplerate, player.channels, "FLOAT", format=kind) as file,
    ):
        yield file.write


@contextmanager
def keyboard() -> Iterator[Any]:
    """A function that waits for a key so many seconds, and gives it or nothing."""
    if not sys.stdin.isatty():
        yield lambda seconds: time.sleep(seconds)
        return
    print(KEYS, file=sys.stderr)
    if sys.platform == "win32":
        import msvcrt

        def wait(seconds: float) -> str | None:
            time.sleep(seconds)
            return msvcrt.getwch() if msvcrt.kbhit() else None

        yield wait
        return
    import select
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield lambda seconds: sys.stdin.read(1) if select.select([sys.stdin], [], [], seconds)[0] else None
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


@contextmanager
def meter() -> Iterator[Any]:
    """A function that shows how a player is doing, on a terminal."""
    if not sys.stderr.isatty():
        with nullcontext():
            yield lambda player: None
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    with Live(Text(""), console=Console(stderr=True), transient=True, auto_refresh=False) as line:
        yield lambda player: line.update(Text(line_of(player.meter())), refresh=True)


def line_of(now: dict[str, Any]) -> str:
    """A meter as one line."""
    level = f"{20 * math.log10(now['peak']):5.1f} dB" if now["peak"] > 1e-5 else "  silent"
    parts = [
        f"{now['seconds']:6.1f} s",
        level,
        f"{now['real_time_factor']:.0f} × real time",
        f"worst block {now['worst_block']:.0%}",
        f"dropouts {now['dropouts']}",
        f"Newton {now['newton']['mean']:.2f}/{now['newton']['max']}",
        f"energy {now['energy_error']:.0e}",
        f"awake {now['awake']}/{now['islands']}",
    ]
    if now["quality_steps"]:
        parts.append(f"quality {now['quality']}, {now['quality_steps']} steps")
    return "  ".join(parts) + (f"  limited {now['limited']}" if now["limited"] else "")


def tell(player: Player, args: argparse.Namespace) -> None:
    """What there is to be said at the end."""
    now = player.meter()
    if args.log:
        with replaced(Path(args.log)) as path:
            path.write_text(json.dumps(player.log()), "utf-8")
    if args.json:
        print(json.dumps({"patch": args.patch, "live": now}))
        return
    print(line_of(now | {"peak": 0.0}).replace("  silent  ", "  "))
    if now["dropouts"]:
        print(f"{now['dropouts']} dropouts: try --block {2 * int(args.block)}, or --latency high")
    if now["limited"]:
        print(f"the limiter held {now['limited']} samples back; a lower --gain")
    for target in (args.record, args.log):
        if target:
            print(target)


def following(path: Path) -> tuple[Path, Scene]:
    """The next patch of the folder that is good."""
    from engine.patch import PatchError, load

    patches = sorted(path.parent.glob("*.toml"))
    at = patches.index(path) if path in patches else -1
    for other in [*patches[at + 1 :], *patches[: at + 1]]:
        try:
            return other, load(str(other))
        except PatchError:
            continue
    raise FileNotFoundError(path)


def wrong(args: argparse.Namespace) -> list[Fault]:
    """What is wrong with the arguments of live sound."""
    faults = []
    if not args.block.isdigit() or not 1 <= int(args.block) <= 65_536:
        faults.append(Fault("render.py", None, "--block", f'"{args.block}" is no size of a block; 1 to 65536 frames'))
    try:
        latency(args.latency)
    except ValueError:
        faults.append(Fault("render.py", None, "--latency", f'"{args.latency}" is no latency; low, high, or seconds'))
    if args.callback not in ("compiled", "python"):
        faults.append(Fault("render.py", None, "--callback", f'unknown callback "{args.callback}"; compiled, python'))
    if args.watch and args.midi:
        faults.append(Fault("render.py", None, "--watch", "cannot be had with --midi; one of them"))
    return faults


if __name__ == "__main__":
    from engine.cli import main

    sys.exit(main([*sys.argv[1:], "--live"]))
