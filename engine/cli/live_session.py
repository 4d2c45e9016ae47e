"""A session of live sound: a patch plays, with keys, a meter and a recording."""

import argparse
import gc
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine.api.pilot import Pilot
from engine.audio_formats import explain_unsupported_format
from engine.cli.console_window import delayed_closing
from engine.cli.live_inputs import open_inputs
from engine.cli.messages import (
    CommandError,
    describe_bodies,
    describe_leftover,
    describe_midi_file,
    print_error,
    print_messages,
    print_result,
)
from engine.cli.notes import add_score, describe_levels, levels_of_file
from engine.cli.option_checks import excerpt_of, voice_count
from engine.cli.progress import progress_feedback
from engine.cli.terminal import meter_parts, read_keyboard, show_meter
from engine.cli.tuning_options import tune
from engine.faults import PatchError
from engine.live import audio_device, midi, midi_drivers, recovery
from engine.live.audio_recording import NoRecording, Recording
from engine.live.controls import Controls
from engine.live.hot_reload import PatchWatcher
from engine.live.key_allocator import live_scene
from engine.live.log_file import LogFile
from engine.live.meter import MeterReading, join_readings
from engine.live.midi_files import is_midi_file
from engine.live.motion_watch import MotionWatch
from engine.live.osc import OscError
from engine.live.player import MAX_LIVE_SUBSTEPS, Player
from engine.offline.statistics import island_statistics
from engine.output_files import error_reason
from engine.patch.rig import explain_accuracy
from engine.patch.scene import Scene, load
from engine.provenance import usable_cores
from engine.report.console import explain_slowness

POLL_INTERVAL = 0.004  # s, between two looks at notes …
WATCH_INTERVAL = 0.02  # s, … at the patch's file …
IDLE_INTERVAL = 0.1  # s, … and at the meter
SWITCH_INTERVAL = 5e-4  # s, between two threads of Python: each that makes tables holds up notes by as much
PILOT_SECONDS = 1.5  # how long a patch is measured before it is played …
QUICK_PILOT_SECONDS = 0.06  # … or an edit of it …
MAX_PILOT_SECONDS = 30.0  # … and how much of it at most
DRIVER_TIMEOUT = 2.0  # s, for the driver to end
SOFTEST = 0.2  # of a hammer's own speed, for key 1; key 5 is as the patch has it
MAX_SIGNALS = 9  # that are waited for
ENDS = {"q": "quit", "n": "next"}


class PlayerFactory:
    """Makes a player for a patch, at the accuracy and the level that the options give."""

    def __init__(self, args: argparse.Namespace, samplerate: int, channels: int) -> None:
        self.args, self.samplerate, self.channels = args, samplerate, channels

    def prepare(self, scene: Scene) -> Scene:
        """The scene of a patch with the notes and at the accuracy that the command line asks for, on as many sides as
        the device has. Raises MidiError."""
        scene = self.with_notes(tune(scene, self.args))
        scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(**self.args.accuracy)})
        return mono_to_stereo(scene) if self.channels > 1 else scene

    def with_notes(self, scene: Scene) -> Scene:
        """The scene with the keys and the score that the notes ask for, if it is an instrument. Raises MidiError."""
        if scene.has_keys and self.is_played_live:
            return live_scene(scene)
        if not self.args.midi or self.is_played_live:
            return scene
        if scene.has_keys:
            scene, lines = add_score(scene, self.args)
        else:
            file = midi.read_for(scene, self.args.midi, excerpt_of(self.args))
            lines = describe_midi_file(self.args.midi, file) + describe_levels(self.args.midi, levels_of_file(file))
        print_messages(lines)
        return scene

    @property
    def is_played_live(self) -> bool:
        """True if notes come from a MIDI port, or from OSC without a file, go on while the patch is edited, or follow a
        clock."""
        if not self.args.midi:
            return self.args.osc is not None
        return not is_midi_file(self.args.midi) or bool(self.args.watch) or self.args.clock is not None

    def make_player(self, scene: Scene, pilot_seconds: float = PILOT_SECONDS) -> Player:
        """A player at a good level. Raises MidiError, BuildError; CommandError if the scene is too slow."""
        args, seconds = self.args, self.args.seconds
        many: dict[str, Any] = {"cores": args.cores or usable_cores(), "kernel": args.kernel}
        many["log"] = args.event_log is not None
        is_waiting = scene.has_keys and self.is_played_live
        if is_waiting:
            many["waiting"] = True
        elif not scene.has_keys and (args.midi or args.voices is not None) and midi.has_notes(scene, args.midi or ""):
            lowest = midi.lowest_ratio(args.midi or "", scene, excerpt_of(args))
            many |= {"voices": voice_count(args), "lowest": lowest}
        if (args.midi or args.watch or args.osc is not None) and seconds is None:
            seconds = math.inf
        make = partial(Player, scene, self.samplerate, math.inf, **many)
        pilot = Pilot(make, args.block_size, MAX_PILOT_SECONDS, pilot_seconds, plays_keys=is_waiting)
        gain = self.find_gain(pilot, describe_bodies(scene))
        del pilot  # and its player, before another one needs the memory
        return Player(scene, self.samplerate, seconds, gain, **many)

    def find_gain(self, pilot: Pilot, size: str) -> float:
        """The gain that an option, the patch or a test run gives, a factor. Raises CommandError if the scene is too
        slow. size: of the scene, in words"""
        with progress_feedback("measuring the speed", size):
            speed = pilot.speed
        if speed < 1.0 and not self.args.ignore_speed:
            remedy = explain_slowness(island_statistics(pilot.player.layout), speed)
            if (rig := pilot.player.patch.rig) is not None and (told := explain_accuracy(rig)):
                remedy += f"; {told}"
            raise CommandError(
                f"TOO SLOW for real time: {speed:.2f} × in the worst case; {remedy}; or give a lower --samplerate, or"
                " --ignore-speed"
            )
        if self.args.gain is not None:
            return float(10 ** (self.args.gain / 20))
        level = pilot.player.patch.level_factor
        return pilot.gain if level is None else level

    def make_quickly(self, scene: Scene) -> Player:
        """Make a player with a shorter test run, as for an edited patch."""
        return self.make_player(scene, QUICK_PILOT_SECONDS)


def mono_to_stereo(scene: Scene) -> Scene:
    """A patch of one channel, to be heard on two: a driver may give one channel to one loudspeaker."""
    if scene.channels > 1:
        return scene
    return scene.model_copy(update={"pickup": [p.model_copy(update={"channel": [1, 2]}) for p in scene.pickup]})


class Session:
    """A patch that a device plays, with all that acts on it: keys of the terminal, notes, controls, and edits.

    Raises DeviceError, MidiError, OscError, CommandError or BuildError if it cannot begin.
    """

    def __init__(self, args: argparse.Namespace, scene: Scene) -> None:
        _, self.device, channels, device_rate = audio_device.find_output(args.device)
        factory = PlayerFactory(args, args.samplerate or device_rate, channels)
        heard, scene = scene.channels, factory.prepare(scene)
        self.args, self.first, compiled = args, factory.make_player(scene), args.callback != "python"
        self.stream = audio_device.open_stream(self.first, args.device, args.block_size, args.latency, compiled)
        self.controls, self.over = Controls(scene, self.first), list[MeterReading]()  # of players that were left
        self.motion = MotionWatch(self.first)
        self.inputs = open_inputs(args, midi.make_allocator(self.first), self.controls, heard)

        def make(edited: Scene) -> Player:
            return self.inputs.prepare(factory.make_quickly(edited))

        making = Path(args.patch), scene, self.first, make, factory.prepare, self._follow
        edited = self.controls.forget
        self.watch = PatchWatcher(*making, edited=edited) if args.watch else None
        self.interval = POLL_INTERVAL if self.inputs.is_open else WATCH_INTERVAL if args.watch else IDLE_INTERVAL

    @property
    def player(self) -> Player:
        """The player that sounds now: the first, or that of an edited patch."""
        return self.first if self.watch is None else self.watch.player

    @property
    def latency(self) -> float:
        """Between a block and its sound, s."""
        return float(np.max(self.stream.latency))

    def _follow(self, scene: Scene, player: Player) -> None:
        """Go on with the player of an edited patch."""
        self.over.append(self.controls.player.meter())
        self.inputs.use(scene, player)
        self.motion.follow(player)

    def reading(self) -> MeterReading:
        """The reading of the meter of the whole session."""
        return join_readings(self.over, self.player.meter())

    def announce(self) -> None:
        """Print what plays, and where."""
        title, rate = self.first.patch.title or Path(self.args.patch).stem, self.first.samplerate
        text = f"{title}, on {self.device} at {rate} Hz, blocks of {self.args.block_size}"
        text += f", latency {1000 * self.latency:.0f} ms"
        text += f", OSC at port {self.inputs.osc_port}" if self.inputs.osc_port else ""
        print(text, file=sys.stderr if self.args.json else sys.stdout, flush=True)

    def play(self, interrupted: list[int]) -> tuple[str, int]:
        """Play to the end, and keep what is to be kept; returns how it ended, and the exit code.

        interrupted: the signals that came
        """
        args = self.args
        with (
            frequent_switches(),
            open_recording(args, self.first) as recording,
            open_log(args, self.first, recording) as write_log,
            read_keyboard(bool(args.record or args.event_log or self.inputs.is_open)) as keys,
            show_meter(args.block_size, self.latency) as show,
        ):
            wish = self._run(recording, write_log, keys, show, interrupted)
        code = report_end(wish, self.device, recording, interrupted)
        if wish == "vanished":
            audio_device.detach_portaudio()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(1)  # PortAudio would wait for a device that does not answer
        return wish, code

    def _run(
        self,
        recording: Recording | NoRecording,
        write_log: Callable[[], None],
        keys: Any,
        show: Any,
        interrupted: list[int],
    ) -> str:
        """Start the stream; keys, notes, meter, recording and log while the driver plays; returns how it ended."""
        wish, deadline, shown = "over", math.inf, -math.inf
        gc.collect()
        gc.freeze()  # to look for garbage in all that was read would hold up a message by 30 ms
        audio_device.start_stream(self.stream)
        while True:
            pressed = keys(self.interval)
            self.motion.poll()
            if self.inputs.poll():
                self.player.stop()
            if time.monotonic() - shown >= IDLE_INTERVAL:
                shown = time.monotonic()
                self._keep(recording)
                write_log()
                self.first.let_go()
                show(self.reading)
            print_messages(self.inputs.take_notices())
            if self.watch is not None:
                print_messages(self.watch.poll())
            ends = [ENDS[key] for key in pressed if key in ENDS]
            if wish == "over" and (interrupted or ends):
                wish = "interrupted" if interrupted else ends[0]
                self.player.stop()
                deadline = time.monotonic() + DRIVER_TIMEOUT + 2 * self.latency
            for key in pressed:
                handle_key(self.player, key)
            if not self.stream.active:
                self._keep(recording)
                return wish if self.first.driver_stopped else "vanished"
            if time.monotonic() > deadline:
                return "vanished"

    def _keep(self, recording: Recording | NoRecording) -> None:
        """Write what was played, if it is recorded."""
        if isinstance(recording, Recording):
            recording.write(self.first.fetch_recording())

    def close(self) -> None:
        """Close the device and all inputs, and print what there is to say of what was played."""
        self.stream.close()
        print_messages([*self.controls.remarks(), *self.inputs.close()])
        now = replace(self.reading(), lost=self.first.lost_frames)
        print_live_summary(now, self.args, self.inputs.allocator, self.motion.warnings())


def play_patch(args: argparse.Namespace, scene: Scene) -> int:
    """Play a patch, and the next ones when the key n is pressed; return the exit code. Raises BuildError."""
    while True:
        try:
            session = Session(args, scene)
        except (audio_device.DeviceError, midi_drivers.MidiError, OscError) as error:
            raise CommandError(error) from error
        session.announce()
        with catch_signals() as interrupted:  # also while it ends
            wish, code = session.play(interrupted)
            session.close()
        if wish != "next" or code:
            return code
        path, scene = next_patch(Path(args.patch))
        args.patch = str(path)


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


@contextmanager
def frequent_switches() -> Iterator[None]:
    """Let the threads of Python take turns often, so that one that makes tables does not hold up the notes."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(usual)


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
    names = "SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {n: signal.getsignal(n) for n in numbers}
    before = {n: how for n, how in before.items() if n == signal.SIGINT or how is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, lambda number, frame: note_signal(signals, number))
    try:
        with delayed_closing(lambda: note_signal(signals, getattr(signal, "SIGBREAK", signal.SIGTERM))):
            yield signals
    finally:
        for number, how in before.items():  # who was told to end ends
            signal.signal(number, signal.SIG_IGN if signals else how)


def note_signal(signals: list[int], number: int) -> None:
    """Note a signal; who sends many does not want to wait for the end."""
    signals.append(number)
    if len(signals) > MAX_SIGNALS:
        os._exit(128 + number)


@contextmanager
def open_log(
    args: argparse.Namespace, player: Player, recording: Recording | NoRecording
) -> Iterator[Callable[[], None]]:
    """Open the log of events, if --event-log names a file; a function writes what has happened to it. Failures become
    lines of the recording."""
    if not args.event_log:
        yield lambda: None
        return
    log = LogFile(args.event_log, player)
    try:
        yield log.write
    finally:
        log.close()
        if log.error is not None:
            recording.is_complete = False
            recording.lines.append(f"cannot write {log.target} ({error_reason(log.error)})")


@contextmanager
def open_recording(args: argparse.Namespace, player: Player) -> Iterator[Recording | NoRecording]:
    """Open the recording that --record names, or a stand-in that keeps nothing."""
    if args.record is None:
        yield NoRecording()
        return
    target = args.record
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


def print_live_summary(
    now: MeterReading, args: argparse.Namespace, allocator: midi.Allocator | None, warnings: list[str]
) -> None:
    """Print the summary of a session. now: its meter; allocator: the one that gave notes to the player"""
    played = allocator.played_notes() if allocator else {}
    if allocator is not None:
        print_messages(describe_leftover([], allocator.ignored, allocator.stolen, allocator.refused))
    print_messages(f"{args.patch}: {warning}" for warning in warnings)
    values = {"patch": args.patch, "live": now.as_dict(), "notes": played, "warnings": warnings}
    print_result(args.json, values, lambda: print_live_text(now, played, args))


def print_live_text(now: MeterReading, played: dict[str, str], args: argparse.Namespace) -> None:
    """Print what was played, the meter, what went wrong, and the files that were written."""
    for body, notes in played.items():
        print(f"{body} plays {notes}")
    print("  ".join(meter_parts(now, args.block_size)))
    remarks = {
        "dropouts": f"dropouts: try --block-size {2 * args.block_size}, or --latency high",
        "limited": "samples were reduced by the limiter; give a lower --gain",
        "capped": f"samples needed more than {MAX_LIVE_SUBSTEPS} steps; a larger max_error needs fewer",
        "not_finite": "samples were not numbers and were muted: this is a bug of the engine; please report the patch",
        "dropped": "events were dropped, because too many came at once",
        "lost": "samples of the recording were lost, because the disk was too slow",
    }
    for key, message in remarks.items():
        if now[key]:
            print(f"{now[key]} {message}")
    for target in (args.record, args.record_midi, args.event_log):
        if target and target.exists():
            print(target)


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
