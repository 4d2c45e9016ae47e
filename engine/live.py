"""Live sound from the command line: play a patch, with keys, a meter and a recording."""

import argparse
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from engine import deck, leftovers, midi, sound
from engine.feedback import feedback, finite
from engine.formats import unheld
from engine.patch import Fault
from engine.player import Player
from engine.recording import Recording, Unrecorded
from engine.reload import Watch
from engine.save import absolute, reason, replaced
from engine.scene import Scene
from engine.silence import deaf

TICK = 0.004  # s, between two looks at notes …
REST = 0.1  # s, … and at the meter and the patch's file
PILOT, LONGEST = 1.5, 30.0  # s: how long a patch is measured before it is played, and how much of it at most
STRETCH = 0.05  # s, of which the dearest counts
RETRIES = 2  # of a patch that seems too heavy
HEADROOM = 0.5  # peak of the pilot in the output: what is struck later may be louder
PATIENCE = 2.0  # s, for the driver to end
SOFTEST = 0.2  # of a hammer's own speed, for key 1; key 5 is as the patch has it
ENDS = {"q": "quit", "n": "next"}
KEYS = "keys: space strike, 1 to 9 softer to harder, m mute, n next patch, q quit"


class TooHeavy(RuntimeError):
    """A patch that is not computed as fast as it sounds."""


def pilot(make: Callable[[], Player], block: int) -> tuple[float, float]:
    """Times real time that the dearest stretch of a patch runs at, and its peak, in SI units; of as much of it as can
    be computed in a moment. The machine may have been busy with something else: what seems too dear is played anew, by
    another player, and of each stretch the quickest counts."""
    costs, peak = _costs(make(), block, math.inf)
    for _ in range(RETRIES):
        if costs.max(initial=0.0) > 1.0:
            again, _ = _costs(make(), block, costs.size)
            costs[: again.size] = np.minimum(costs[: again.size], again)
    return 1.0 / float(costs.max(initial=1e-9)), peak


def _costs(player: Player, block: int, most: float) -> tuple[np.ndarray, float]:
    """Time spent per time of sound, of each stretch of a patch; and its peak."""
    if player.voices:
        player.strike()
    rate = player.samplerate
    out, costs, spent, played = np.zeros((block, player.channels), np.float32), list[float](), 0.0, 0
    limit, started = min(LONGEST, player.scene.seconds) * rate, time.perf_counter()
    while player.frame < limit and time.perf_counter() - started < PILOT and len(costs) < most:
        begin = time.perf_counter()
        player.play(out)
        spent, played = spent + time.perf_counter() - begin, played + block
        if played >= STRETCH * rate:
            costs.append(spent / played * rate)
            spent, played = 0.0, 0
    if played and not costs:
        costs.append(spent / played * rate)
    return np.array(costs), float(player.gauge[deck.PEAK])


class Desk:
    """How a patch is brought to a player: at the accuracy and the level asked for."""

    def __init__(
        self, args: argparse.Namespace, gain: float | None, dial: dict[str, Any], samplerate: int, channels: int
    ) -> None:
        self.args, self.gain, self.dial, self.samplerate, self.channels = args, gain, dial, samplerate, channels

    def dialled(self, scene: Scene) -> Scene:
        """The scene at the accuracy that the command line asks for, on as many sides as the device has."""
        scene = scene.model_copy(update={"accuracy": scene.accuracy.but(**self.dial)})
        return on_both_sides(scene) if self.channels > 1 else scene

    def ready(self, scene: Scene) -> Player:
        """A player at a good level. Raises TooHeavy unless told to play all the same, MidiError, BuildError."""
        args, many = self.args, dict[str, Any]()
        seconds = None if args.seconds is None else float(args.seconds)
        if args.midi:
            many = {"voices": int(args.voices), "lowest": midi.lowest(args.midi, scene)}
        if (args.midi or args.watch) and seconds is None:
            seconds = math.inf
        with feedback(args.json):
            speed, peak = pilot(lambda: Player(scene, self.samplerate, **many), int(args.block))
        if speed < 1.0 and not args.force:
            raise TooHeavy(
                f"too heavy for real time: {speed:.2f} × at its busiest; fewer modes or points of contact, a lower"
                " --samplerate, or --force"
            )
        silent = peak == 0.0 or deaf(scene)
        factor = 10 ** (self.gain / 20) if self.gain is not None else 1.0 if silent else HEADROOM / peak
        return Player(scene, self.samplerate, seconds, factor, **many)


def on_both_sides(scene: Scene) -> Scene:
    """A patch of one channel, to be heard on two: a driver may give one channel to one loudspeaker."""
    if any(p.channel > 1 for p in scene.pickup):
        return scene
    return scene.model_copy(
        update={"pickup": [p.model_copy(update={"channel": c}) for c in (1, 2) for p in scene.pickup]}
    )


def play(args: argparse.Namespace, scene: Scene, gain: float | None, dial: dict[str, Any]) -> int:
    """Play a patch, and those after it if asked; returns the exit code. Raises BuildError."""
    path = Path(args.patch)
    while True:
        try:
            _, name, channels, own = sound.output(args.device)
            samplerate = own if args.samplerate is None else int(float(args.samplerate))
            desk = Desk(args, gain, dial, samplerate, channels)
            scene = desk.dialled(scene)
            player = desk.ready(scene)
            compiled, wait = args.callback != "python", latency(args.latency)
            stream = sound.stream(player, args.device, int(args.block), wait, compiled)
            keyed = midi.Keys(player) if args.midi else None
            notes = midi.source(args.midi, keyed) if keyed else None
        except (sound.SoundError, midi.MidiError, TooHeavy) as error:
            print(f"render.py: {error}", file=sys.stderr)
            return 1
        told = f"{scene.title or path.stem}, on {name} at {samplerate} Hz, blocks of {args.block}"
        print(told, file=sys.stderr if args.json else sys.stdout, flush=True)
        watch = Watch(path, scene, player, desk.ready, desk.dialled) if args.watch else None
        wish, code = performed(args, player, stream, name, watch, notes)
        stream.close()
        tell(watch.player if watch is not None else player, args, midi.told_of(keyed) if keyed else {})
        if wish != "next" or code:
            return code
        path, scene = following(path)
        args.patch = str(path)


def performed(
    args: argparse.Namespace,
    player: Player,
    stream: Any,
    name: str,
    watch: Watch | None,
    notes: midi.Source | None,
) -> tuple[str, int]:
    """Play to the end, and keep what is to be kept; returns how it ended, and the exit code. name: of the device."""
    log = absolute(Path(args.log)) if args.log else None
    with interrupts() as interrupted:
        with (
            recording(args, player) as kept,
            keyboard(bool(args.record or args.log or args.midi)) as keys,
            meter(int(args.block)) as show,
        ):
            wish = attend(player, stream, kept.write, keys, show, watch, notes, interrupted)
        keep_log(player, log, kept)
    code = ended(wish, name, kept, interrupted)
    if wish == "vanished":
        sound.forget()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(1)  # PortAudio would wait for a device that does not answer
    return wish, code


def ended(wish: str, name: str, kept: Recording | Unrecorded, interrupted: list[int]) -> int:
    """Say how it ended; returns the exit code. name: of the device."""
    if wish == "vanished":
        print(f"render.py: {name} is gone; what was recorded is kept", file=sys.stderr)
    elif wish == "interrupted" and interrupted[0] != signal.SIGINT:
        print(f"render.py: ended by {signal.Signals(interrupted[0]).name}", file=sys.stderr)
    for line in kept.lines:
        print(f"render.py: {line}", file=sys.stderr)
    if not kept.whole or wish == "vanished":
        return 1
    return 128 + interrupted[0] if wish == "interrupted" else 0


def latency(text: str | None) -> str | float | None:
    """What sounddevice takes: low, high, or seconds. Raises ValueError."""
    if text in (None, "low", "high"):
        return text
    seconds = float(text or "")
    if not 0.0 < seconds <= 10.0:
        raise ValueError(text)
    return seconds


def attend(
    first: Player,
    stream: Any,
    write: Any,
    keys: Any,
    show: Any,
    watch: Watch | None,
    notes: midi.Source | None,
    interrupted: list[int],
) -> str:
    """Start the stream; keys, notes, meter and recording while the driver plays; returns how it ended."""
    wish, deadline, player, shown = "over", math.inf, first, -math.inf
    sound.start(stream)
    while True:
        pressed = keys(TICK if notes is not None else REST)
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
        ends = [ENDS[key] for key in pressed if key in ENDS]
        if wish == "over" and (interrupted or ends):
            wish = "interrupted" if interrupted else ends[0]
            player.stop()
            deadline = time.monotonic() + PATIENCE + 2 * float(np.max(stream.latency))
        for key in pressed:
            press(player, key)
        if not stream.active:
            write(first.fetch())
            return wish if first.ended else "vanished"
        if time.monotonic() > deadline:
            return "vanished"


def press(player: Player, key: str) -> None:
    """What a key does, but for those that end it all."""
    if key == "m":
        player.damp()
    elif key in (" ", "s"):
        player.strike()
    elif key in "123456789":
        for hammer in player.hammers:
            player.strike(hammer, SOFTEST * int(key) * player.speed(hammer))


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """A list that holds a signal once Ctrl-C was pressed, the program was told to end, or its terminal was closed:
    nothing is broken off half-way. What the program was started to ignore, as by nohup, it ignores."""
    found: list[int] = []
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {n: signal.getsignal(n) for n in numbers}
    before = {n: how for n, how in before.items() if n == signal.SIGINT or how is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, lambda number, frame: found.append(number))
    try:
        yield found
    finally:
        for number, how in before.items():
            signal.signal(number, how)


@contextmanager
def recording(args: argparse.Namespace, player: Player) -> Iterator[Recording | Unrecorded]:
    """What takes samples, and keeps them in a file if asked."""
    if args.record is None:
        yield Unrecorded()
        return
    target = Path(args.record)
    if what := unheld(target, player.samplerate, player.channels):
        raise sound.SoundError(f"--record: {what}")
    if said := leftovers.notice(target.parent):
        print(f"render.py: {said}", file=sys.stderr)
    kept, played = Recording(target, player.samplerate, player.channels, args.subtype), False
    try:
        yield kept
        played = True
    finally:
        kept.close(played)


@contextmanager
def keyboard(alone: bool) -> Iterator[Any]:
    """A function that waits so many seconds for keys, and gives those that were pressed; without that for the next
    patch, where one alone is to be recorded."""

    def none(seconds: float) -> str:
        time.sleep(seconds)
        return ""

    if sys.stdin is None or not sys.stdin.isatty():
        yield none
        return
    print(KEYS.replace("n next patch, ", "") if alone else KEYS, file=sys.stderr)
    unused = "n" if alone else ""
    if sys.platform == "win32":
        import msvcrt

        def waiting(seconds: float) -> str:
            time.sleep(seconds)
            return "".join(iter(lambda: msvcrt.getwch() if msvcrt.kbhit() else "", "")).replace(unused, "")

        yield waiting
        return
    with terminal(sys.stdin.fileno()) as pressed:
        yield lambda seconds: pressed(seconds).replace(unused, "")


@contextmanager
def terminal(number: int) -> Iterator[Callable[[float], str]]:
    """A function that waits for keys of a terminal, which is as it was when all is over."""
    import select
    import termios
    import tty

    def pressed(seconds: float) -> str:
        try:
            if not select.select([number], [], [], seconds)[0]:
                return ""
            found = os.read(number, 64)
        except OSError:
            found = b""
        if not found:  # it was closed, and will always answer at once
            time.sleep(seconds)
        return found.decode(errors="replace")

    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number)
        yield pressed
    finally:
        with suppress(termios.error):
            termios.tcsetattr(number, termios.TCSADRAIN, before)


@contextmanager
def meter(block: int) -> Iterator[Any]:
    """A function that shows how a player is doing, on a terminal."""
    if not sys.stderr.isatty():
        with nullcontext():
            yield lambda player: None
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    with Live(Text(""), console=Console(stderr=True), transient=True, auto_refresh=False) as line:
        yield lambda player: line.update(Text(line_of(player.meter(), block)), refresh=True)


def line_of(now: dict[str, Any], block: int) -> str:
    """A meter as one line; block: frames of one, as asked for."""
    level = f"{20 * math.log10(now['peak']):5.1f} dB" if now["peak"] > 1e-5 else "  silent"
    parts = [
        f"{now['seconds']:6.1f} s",
        level,
        f"{now['real_time_factor']:.0f} × real time",
        f"worst block {now['worst_block']:.0%}",
        f"dropouts {now['dropouts']}" + (f" (try --block {2 * block})" if now["dropouts"] else ""),
        f"Newton {now['newton']['mean']:.2f}/{now['newton']['max']}",
        f"energy {now['energy_error']:.0e}",
        f"awake {now['awake']}/{now['islands']}",
    ]
    if now["voices"]:
        parts.append(f"voices {now['sounding']}/{now['voices']}")
    if now["quality_steps"]:
        parts.append(f"quality {now['quality']}, {now['quality_steps']} steps")
    return "  ".join(parts) + (f"  limited {now['limited']}" if now["limited"] else "")


def tell(player: Player, args: argparse.Namespace, played: dict[str, str]) -> None:
    """What there is to be said at the end. played: which body played which notes."""
    now = player.meter()
    if args.json:
        print(json.dumps({"patch": args.patch, "live": finite(now), "notes": played}))
        return
    for body, notes in played.items():
        print(f"{body} plays {notes}")
    print(line_of(now | {"peak": 0.0}, int(args.block)).replace("  silent  ", "  "))
    said = {
        "dropouts": f"dropouts: try --block {2 * int(args.block)}, or --latency high",
        "limited": "samples held back by the limiter; a lower --gain",
        "not_finite": "samples that were no numbers, and silenced: a fault of the engine; please report the patch",
        "dropped": "events dropped: too many at once",
        "lost": "samples of the recording lost: the disk was too slow",
    }
    for key, what in said.items():
        if now[key]:
            print(f"{now[key]} {what}")
    for target in (args.record, args.log):
        if target and Path(target).exists():
            print(target)


def keep_log(player: Player, path: Path | None, kept: Recording | Unrecorded) -> None:
    """Write what was done, if asked; what is to be said of it goes to what was kept of the sound."""
    if path is None:
        return
    told = json.dumps(player.log())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)  # it was there before
        with replaced(path) as part:
            part.write_text(told, "utf-8")
    except OSError as error:
        kept.whole = False
        kept.lines.append(f"cannot write {path} ({reason(error)})")


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
    if not args.block.isdecimal() or not 1 <= int(args.block) <= 65_536:
        faults.append(Fault("render.py", None, "--block", f'"{args.block}" is no size of a block; 1 to 65536 frames'))
    try:
        latency(args.latency)
    except ValueError:
        faults.append(Fault("render.py", None, "--latency", f'"{args.latency}" is no latency; low, high, or seconds'))
    if args.callback not in ("compiled", "python"):
        faults.append(Fault("render.py", None, "--callback", f'unknown callback "{args.callback}"; compiled, python'))
    for option in ("midi", "log"):
        if args.watch and getattr(args, option):
            faults.append(Fault("render.py", None, "--watch", f"cannot be had with --{option}; one of them"))
    return faults


if __name__ == "__main__":
    from engine.cli import main

    sys.exit(main([*sys.argv[1:], "--live"]))
