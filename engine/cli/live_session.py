"""A session of live sound: a patch plays, with keys, a meter and a recording."""

import argparse
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine.analysis.silence import is_inaudible
from engine.audio_formats import explain_unsupported_format
from engine.cli.live_inputs import Inputs, open_inputs
from engine.cli.messages import describe_bodies, describe_leftover, describe_midi_file, print_error
from engine.cli.option_checks import excerpt_of, parse_latency, voice_count
from engine.cli.progress import progress_feedback
from engine.cli.terminal import meter_parts, read_keyboard, show_meter
from engine.compiler import background
from engine.faults import PatchError
from engine.instrument.score_events import FULL_VELOCITY
from engine.live import audio_device, midi, midi_notes, recovery
from engine.live.audio_recording import NoRecording, Recording
from engine.live.controls import Controls
from engine.live.hot_reload import PatchWatcher
from engine.live.instrument_notes import scene_of_file
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_parts import Excerpt
from engine.live.osc import OscError
from engine.live.player import HEADROOM, Player
from engine.live.shared_memory import Gauge
from engine.offline.statistics import island_statistics
from engine.output_files import absolute_path, atomic_write, error_reason
from engine.patch.scene import Scene, load
from engine.report.console import explain_slowness
from engine.wording import json_safe

POLL_INTERVAL = 0.004  # s, between two looks at notes …
WATCH_INTERVAL = 0.02  # s, … at the patch's file …
IDLE_INTERVAL = 0.1  # s, … and at the meter
PILOT_SECONDS = 1.5  # how long a patch is measured before it is played …
QUICK_PILOT_SECONDS = 0.06  # … or an edit of it …
MAX_PILOT_SECONDS = 30.0  # … and how much of it at most
WINDOW = 0.05  # s, of which the dearest counts
KEY_SECONDS = 0.25  # of a key that is played to find the level of an instrument
RETRIES = 2  # of a patch that seems too heavy
DRIVER_TIMEOUT = 2.0  # s, for the driver to end
SOFTEST = 0.2  # of a hammer's own speed, for key 1; key 5 is as the patch has it
ENDS = {"q": "quit", "n": "next"}


class TooSlow(RuntimeError):
    """A patch that is not computed as fast as it sounds."""


def measure_speed(make: Callable[[], Player], block: int, pilot_seconds: float = PILOT_SECONDS) -> tuple[float, float]:
    """Times real time that the dearest stretch of a patch runs at, and its peak, in SI units; of as much of it as can
    be computed in a moment. The machine may have been busy with something else: what seems too dear is played anew, by
    another player, and of each stretch the quickest counts."""
    costs, peak = window_costs(make(), block, math.inf, pilot_seconds)
    for _ in range(RETRIES):
        if costs.max(initial=0.0) > 1.0:
            repeated, _ = window_costs(make(), block, costs.size, pilot_seconds)
            costs[: repeated.size] = np.minimum(costs[: repeated.size], repeated)
    return 1.0 / float(costs.max(initial=1e-9)), peak


def window_costs(player: Player, block: int, most: float, pilot_seconds: float) -> tuple[np.ndarray, float]:
    """Time spent per time of sound, of each stretch of a patch; and its peak."""
    if player.voices:
        player.strike()
    rate = player.samplerate
    out, costs, spent, played = np.zeros((block, player.channels), np.float32), list[float](), 0.0, 0
    limit, started = min(MAX_PILOT_SECONDS, player.scene.seconds) * rate, time.perf_counter()
    while player.frame < limit and time.perf_counter() - started < pilot_seconds and len(costs) < most:
        begin = time.perf_counter()
        player.render_into(out)
        spent, played = spent + time.perf_counter() - begin, played + block
        if played >= WINDOW * rate:
            costs.append(spent / played * rate)
            spent, played = 0.0, 0
    if played and not costs:
        costs.append(spent / played * rate)
    press_middle_key(player, block)
    return np.array(costs), float(player.gauges[Gauge.PEAK])


def press_middle_key(player: Player, block: int) -> None:
    """Play the middle key of an instrument that waits for notes, as loud as can be, so that its level is known."""
    keys = midi.make_allocator(player)
    if isinstance(keys, KeyAllocator):
        keys.play(midi_notes.Note(0.0, "on", keys.keys[len(keys.keys) // 2], FULL_VELOCITY))
        for _ in range(math.ceil(KEY_SECONDS * player.samplerate / block)):
            player.render_into(np.zeros((block, player.channels), np.float32))


class PlayerFactory:
    """Makes a player for a patch, at the accuracy and the level that the options give."""

    def __init__(
        self, args: argparse.Namespace, gain: float | None, accuracy: dict[str, Any], samplerate: int, channels: int
    ) -> None:
        self.args, self.gain, self.accuracy, self.samplerate, self.channels = args, gain, accuracy, samplerate, channels

    def prepare(self, scene: Scene) -> Scene:
        """The scene of a patch with the notes and at the accuracy that the command line asks for, on as many sides as
        the device has. Raises MidiError."""
        scene = self.with_notes(scene)
        scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**self.accuracy)})
        return mono_to_stereo(scene) if self.channels > 1 else scene

    def with_notes(self, scene: Scene) -> Scene:
        """The scene with the keys and the score that the notes ask for, if it is an instrument. Raises MidiError."""
        if scene.instrument and self.is_played_live:
            return live_scene(scene)
        if not self.args.midi or self.is_played_live:
            return scene
        lines = list[str]()
        if scene.instrument:
            played = scene_of_file(scene, Path(self.args.midi), self.excerpt)
            scene, file, lines = played.scene, played.file, describe_leftover(played.refused, played.ignored)
        else:
            file = midi.read_for(scene, self.args.midi, self.excerpt)
        for line in describe_midi_file(self.args.midi, file) + lines:
            print(line, file=sys.stderr)
        return scene

    @property
    def excerpt(self) -> Excerpt:
        """The excerpt of a MIDI file that is played."""
        return excerpt_of(self.args, None if self.args.seconds is None else float(self.args.seconds))

    @property
    def is_played_live(self) -> bool:
        """True if notes come from a MIDI port, or from OSC without a file."""
        return not midi.is_file(self.args.midi) if self.args.midi else self.args.osc is not None

    def make_player(self, scene: Scene, pilot_seconds: float = PILOT_SECONDS) -> Player:
        """A player at a good level. Raises TooSlow unless told to play all the same, MidiError, BuildError."""
        args = self.args
        many: dict[str, Any] = {"cores": os.cpu_count() or 1 if args.cores is None else int(float(args.cores))}
        many["kernel"] = args.kernel
        seconds = None if args.seconds is None else float(args.seconds)
        if scene.instrument and self.is_played_live:
            many["waiting"] = True
        elif not scene.instrument and (args.midi or args.voices is not None) and midi.has_notes(scene, args.midi or ""):
            lowest = midi.lowest_ratio(args.midi or "", scene, self.excerpt)
            many |= {"voices": voice_count(args), "lowest": lowest}
        if (args.midi or args.watch or args.osc is not None) and seconds is None:
            seconds = math.inf
        make = partial(Player, scene, self.samplerate, math.inf, **many)
        with progress_feedback("measuring the speed", describe_bodies(scene)):
            speed, peak = measure_speed(make, int(args.block_size), pilot_seconds)
        if speed < 1.0 and not args.ignore_speed:
            remedy = explain_slowness(island_statistics(make().layout), speed)
            raise TooSlow(
                f"TOO SLOW for real time: {speed:.2f} × in the worst case; {remedy}; or give a lower --samplerate, or"
                " --ignore-speed"
            )
        silent = peak == 0.0 or (not many.get("waiting") and is_inaudible(scene))
        factor = 10 ** (self.gain / 20) if self.gain is not None else 1.0 if silent else HEADROOM / peak
        return Player(scene, self.samplerate, seconds, factor, **many)

    def make_quickly(self, scene: Scene) -> Player:
        """Make a player with a shorter test run, as for an edited patch."""
        return self.make_player(scene, QUICK_PILOT_SECONDS)


def mono_to_stereo(scene: Scene) -> Scene:
    """A patch of one channel, to be heard on two: a driver may give one channel to one loudspeaker."""
    if scene.channels > 1:
        return scene
    return scene.model_copy(update={"pickup": [p.model_copy(update={"channel": [1, 2]}) for p in scene.pickup]})


def play_patch(args: argparse.Namespace, scene: Scene, gain: float | None, accuracy: dict[str, Any]) -> int:
    """Play a patch, and the next ones when the key n is pressed; return the exit code. Raises BuildError."""
    path = Path(args.patch)
    while True:
        try:
            _, name, channels, device_rate = audio_device.find_output(args.device)
            samplerate = device_rate if args.samplerate is None else int(float(args.samplerate))
            factory = PlayerFactory(args, gain, accuracy, samplerate, channels)
            scene = factory.prepare(scene)
            player = factory.make_player(scene)
            compiled, wait = args.callback != "python", parse_latency(args.latency)
            stream = audio_device.open_stream(player, args.device, int(args.block_size), wait, compiled)
            allocator = midi.make_allocator(player)
            controls = Controls(scene, player)
            source = open_inputs(args, allocator, controls, factory.excerpt)
        except (audio_device.DeviceError, midi_notes.MidiError, OscError, TooSlow) as error:
            print_error(error)
            return 1
        announcement = f"{scene.title or path.stem}, on {name} at {samplerate} Hz, blocks of {args.block_size}"
        announcement += f", OSC at port {source.osc_port}" if source.osc_port else ""
        print(announcement, file=sys.stderr if args.json else sys.stdout, flush=True)
        making = path, scene, player, factory.make_quickly, factory.prepare, source.use
        watch = PatchWatcher(*making) if args.watch else None
        with background.postponed():
            wish, code = play_to_end(args, player, stream, name, watch, source)
        stream.close()
        for line in [*controls.remarks(), *source.close()]:
            print(line, file=sys.stderr)
        background.compile_beside((watch.player if watch is not None else player).memory.missing_kernels)
        print_live_summary(watch.player if watch is not None else player, args, allocator)
        if wish != "next" or code:
            return code
        path, scene = next_patch(path)
        args.patch = str(path)


def play_to_end(
    args: argparse.Namespace,
    player: Player,
    stream: Any,
    name: str,
    watch: PatchWatcher | None,
    inputs: Inputs,
) -> tuple[str, int]:
    """Play to the end, and keep what is to be kept; returns how it ended, and the exit code. name: of the device."""
    log = absolute_path(Path(args.event_log)) if args.event_log else None
    with catch_signals() as interrupted:
        with (
            open_recording(args, player) as recording,
            read_keyboard(bool(args.record or args.event_log or inputs.is_open)) as keys,
            show_meter(int(args.block_size)) as show,
        ):
            wish = run_session(player, stream, recording.write, keys, show, watch, inputs, interrupted)
        write_log(player, log, recording)
    code = report_end(wish, name, recording, interrupted)
    if wish == "vanished":
        audio_device.detach_portaudio()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(1)  # PortAudio would wait for a device that does not answer
    return wish, code


def report_end(wish: str, name: str, recording: Recording | NoRecording, interrupted: list[int]) -> int:
    """Say how it ended; returns the exit code. name: of the device."""
    if wish == "vanished":
        print_error(f"{name} was disconnected; the recording is kept")
    elif wish == "interrupted" and interrupted[0] != signal.SIGINT:
        print_error(f"ended by {signal.Signals(interrupted[0]).name}")
    for line in recording.lines:
        print_error(line)
    if not recording.is_complete or wish == "vanished":
        return 1
    return 128 + interrupted[0] if wish == "interrupted" else 0


def run_session(
    first: Player,
    stream: Any,
    write: Any,
    keys: Any,
    show: Any,
    watch: PatchWatcher | None,
    inputs: Inputs,
    interrupted: list[int],
) -> str:
    """Start the stream; keys, notes, meter and recording while the driver plays; returns how it ended."""
    wish, deadline, player, shown = "over", math.inf, first, -math.inf
    audio_device.start_stream(stream)
    while True:
        pressed = keys(POLL_INTERVAL if inputs.is_open else IDLE_INTERVAL if watch is None else WATCH_INTERVAL)
        if inputs.poll():
            player.stop()
        if time.monotonic() - shown >= IDLE_INTERVAL:
            shown = time.monotonic()
            write(first.fetch_recording())
            show(player)
        for line in inputs.take_notices():
            print(line, file=sys.stderr)
        if watch is not None:
            for line in watch.poll():
                print(line, file=sys.stderr)
            player = watch.player
        ends = [ENDS[key] for key in pressed if key in ENDS]
        if wish == "over" and (interrupted or ends):
            wish = "interrupted" if interrupted else ends[0]
            player.stop()
            deadline = time.monotonic() + DRIVER_TIMEOUT + 2 * float(np.max(stream.latency))
        for key in pressed:
            handle_key(player, key)
        if not stream.active:
            write(first.fetch_recording())
            return wish if first.driver_stopped else "vanished"
        if time.monotonic() > deadline:
            return "vanished"


def handle_key(player: Player, key: str) -> None:
    """Carry out the action of a key, except of the keys that end the session or change the patch."""
    if key == "m":
        player.damp()
    elif key in (" ", "s"):
        player.strike()
    elif key in "123456789":
        for hammer in player.strikers:
            player.strike(hammer, SOFTEST * int(key) * player.default_velocity(hammer))


@contextmanager
def catch_signals() -> Iterator[list[int]]:
    """A list that holds a signal once Ctrl-C was pressed, the program was told to end, or its terminal was closed:
    nothing is broken off half-way. What the program was started to ignore, as by nohup, it ignores."""
    signals: list[int] = []
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {n: signal.getsignal(n) for n in numbers}
    before = {n: how for n, how in before.items() if n == signal.SIGINT or how is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, lambda number, frame: signals.append(number))
    try:
        yield signals
    finally:
        for number, how in before.items():
            signal.signal(number, how)


@contextmanager
def open_recording(args: argparse.Namespace, player: Player) -> Iterator[Recording | NoRecording]:
    """Open the recording that --record names, or a stand-in that keeps nothing."""
    if args.record is None:
        yield NoRecording()
        return
    target = Path(args.record)
    if message := explain_unsupported_format(target, player.samplerate, player.channels):
        raise audio_device.DeviceError(f"--record: {message}")
    if leftovers := recovery.describe_leftovers(target.parent):
        print_error(leftovers)
    recording, played = Recording(target, player.samplerate, player.channels, args.subtype), False
    try:
        yield recording
        played = True
    finally:
        recording.close(played)


def print_live_summary(player: Player, args: argparse.Namespace, allocator: midi.Allocator | None) -> None:
    """Print the summary of a session. allocator: the one that gave notes to the player"""
    now, played = player.meter(), allocator.played_notes() if allocator else {}
    if allocator is not None:
        for line in describe_leftover([], allocator.ignored, allocator.stolen, allocator.refused):
            print(line, file=sys.stderr)
    if args.json:
        print(json.dumps({"patch": args.patch, "live": json_safe(now.as_dict()), "notes": played}))
        return
    for body, notes in played.items():
        print(f"{body} plays {notes}")
    print("  ".join(meter_parts(now, int(args.block_size))))
    remarks = {
        "dropouts": f"dropouts: try --block-size {2 * int(args.block_size)}, or --latency high",
        "limited": "samples were reduced by the limiter; give a lower --gain",
        "not_finite": "samples were not numbers and were muted: this is a bug of the engine; please report the patch",
        "dropped": "events were dropped, because too many came at once",
        "lost": "samples of the recording were lost, because the disk was too slow",
    }
    for key, message in remarks.items():
        if now[key]:
            print(f"{now[key]} {message}")
    for target in (args.record, args.event_log):
        if target and Path(target).exists():
            print(target)


def write_log(player: Player, path: Path | None, recording: Recording | NoRecording) -> None:
    """Write the log of events, if --event-log names a file; failures become lines of the recording."""
    if path is None:
        return
    text = json.dumps(player.log())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)  # it was there before
        with atomic_write(path) as part:
            part.write_text(text, "utf-8")
    except OSError as error:
        recording.is_complete = False
        recording.lines.append(f"cannot write {path} ({error_reason(error)})")


def next_patch(path: Path) -> tuple[Path, Scene]:
    """The next patch of the folder that is good."""
    patches = sorted(path.parent.glob("*.toml"))
    at = patches.index(path) if path in patches else -1
    for following in [*patches[at + 1 :], *patches[: at + 1]]:
        try:
            return following, load(str(following))
        except PatchError:
            continue
    raise FileNotFoundError(path)
