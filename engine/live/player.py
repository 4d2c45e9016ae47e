"""A scene that is played while events come: strikes, plucks, dampers, live parameters.

    player = Player(fdh.load("patches/piano_c4.toml"), gain=0.1)
    stream = engine.live.audio_device.open_stream(player, None, 256, None)
    stream.start()
    player.strike("hammer", velocity=3.0)
    player.set("contact.felt.stiffness", 1e9)

Events go through a queue to the audio thread, which never waits for Python, and are kept in a log; a replay of the log
gives the same samples, bit for bit.
"""

import json
import math
import time
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from engine.argument_checks import checked_integer, checked_number, values_by_path
from engine.assembly.build import build
from engine.assembly.event_table import EventRow
from engine.assembly.table_changes import NewValue, TableChanges
from engine.assembly.table_digest import digest_tables
from engine.bodies import Mass
from engine.compiler.clock import clock_address
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import UNUSED_SLOT, EventKind, Sleep
from engine.live.audio_memory import QUEUE_SIZE, AudioMemory, coarser_models
from engine.live.event_queue import EventQueue, RowSet, checked_frame, event_capacity
from engine.live.event_rows import MUTE_SECONDS, MUTE_SIGMA, EventRows
from engine.live.kernels import PLAY_INTO, kernel_of_memory
from engine.live.meter import MeterReading
from engine.live.parameter_queue import ParameterQueue
from engine.live.player_options import checked_options
from engine.live.retuning import VoiceTuning
from engine.live.shared_memory import Gauge, Slot
from engine.live.voices import replicate, retune, with_chosen_residuals
from engine.offline.energy_statistics import energy_statistics
from engine.offline.statistics import capped_samples, newton_statistics
from engine.patch.frames import check_samplerate, nearest_frame
from engine.patch.live_parameters import GLIDED_KEYS, LivePath, live_paths, output_paths
from engine.patch.scene import Scene, check_scene
from engine.patch.tables import ChangeEvent, Event
from engine.runtime.helpers import start_helpers

CROSS_FADE_SECONDS = 0.02
LET_GO_SECONDS = 1.0  # after which the audio thread has no business with a player that is over
BUILT_WITH_PLAYER = (  # what is let go; live_paths of an instrument are some thousand
    *("model", "state", "layout", "rows", "scene", "live_paths"),
    *("_tuning", "_parameters", "_queue", "_helpers"),
)
GLIDE_SECONDS = 0.02  # of a live parameter
HEADROOM = 0.5  # of full scale, for the peak of what is played first: what is struck later may be louder
MAX_LIVE_SUBSTEPS = 64  # of a sample whose steps are chosen by error


class Player:
    """A scene, ready to be played.

    seconds: until it fades out; the scene's own if None; `math.inf`: until it is stopped
    gain:    factor on SI units
    options: of PlayerOptions, by name
    Raises TypeError if an argument is of the wrong kind, BuildError as `engine.assembly.build.build`.
    """

    queue_size = QUEUE_SIZE  # events

    def __init__(
        self,
        scene: Scene,
        samplerate: int = 44_100,
        seconds: float | None = None,
        gain: float = 1.0,
        **options: Any,
    ) -> None:
        check_scene(scene)
        samplerate, gain = checked_integer("samplerate", samplerate), checked_number("gain", gain)
        self.options = chosen = checked_options(options)
        seconds = scene.seconds if seconds is None else checked_number("seconds", seconds)
        if not math.isfinite(gain):
            raise ValueError(f"gain = {gain} is not a finite factor")
        if not seconds > 0.0:
            raise ValueError(f"seconds = {seconds:g} is out of range; more than 0")
        check_samplerate(samplerate)
        if scene.accuracy.oversample > 1:
            message = "live sound cannot be oversampled; use order or substeps, or render the patch"
            raise BuildError(Fault("accuracy.oversample", message))
        self.patch, self.voices, self.waiting = scene, chosen.voices, chosen.waiting
        if self.voices:
            plain = scene.accuracy.replace(order=2, substeps=1)  # a voice is tuned table by table
            copies = replicate(retune(with_chosen_residuals(scene, samplerate), chosen.lowest), self.voices)
            scene = copies.model_copy(update={"accuracy": plain.model_copy(update={"max_error": None})})
        elif scene.accuracy.max_error is not None:  # no sample may take as long as a block
            limited = scene.accuracy.replace(max_substeps=min(MAX_LIVE_SUBSTEPS, scene.accuracy.max_substeps))
            scene = scene.model_copy(update={"accuracy": limited})
        self.scene, self.samplerate, self.gain = scene, samplerate, gain
        self.channels = scene.channels
        capacity = event_capacity(scene, self.waiting and not self.voices)
        built_with: dict[str, Any] = {"event_capacity": capacity}
        self.model, self.state, self.layout = built = build(scene, samplerate, **built_with)
        self.table_digest = digest_tables(self.model, self.state)
        if self.waiting:
            self.model.force.start[:] = UNUSED_SLOT
        self.rows = EventRows(self.patch, built, samplerate, self.voices)
        self.memory = AudioMemory(built, scene.accuracy, self.channels, seconds, gain, chosen.kernel, self.queue_size)
        shared = self.memory.shared
        self.counters, self.gauges = shared.counters, shared.gauges
        self.counters[Slot.CLOCK] = clock_address()
        if scene.tremolo is not None:
            tremolo = [Gauge.TREMOLO_DEPTH, Gauge.TREMOLO_TURNS, Gauge.TREMOLO_SPREAD]
            self.gauges[tremolo] = scene.tremolo.depth, scene.tremolo.rate / samplerate, scene.tremolo.spread
        self._helpers = start_helpers(chosen.cores, self.model.islands.partition.size - 1, in_realtime=True)
        self.memory.job_memory.use_helpers(self._helpers)
        self._queue = EventQueue(self.memory, chosen.log)
        self._tuning = VoiceTuning(self.patch, chosen, built, built_with, self._queue, shared)
        coarser = partial(coarser_models, accuracy=scene.accuracy)
        tables = TableChanges(scene, built, self.memory.models, coarser, **built_with)
        known = self.live_paths | output_paths(self.channels)
        self._parameters = ParameterQueue(known, tables, self._queue, shared)
        if not self.voices:
            self._parameters.plan_score(scene)
        self._fetched = self.lost_frames = 0
        self._is_over_since: float | None = None
        self._successor: Player | None = None

    # --- playing

    def render_into(self, out: np.ndarray) -> None:
        """Play the next len(out) frames into out, single precision [frames, channels], contiguous; silence once all is
        over. Raises ValueError for another array, TypeError for none."""
        if not isinstance(out, np.ndarray):
            raise TypeError(f"out must be an array, not {type(out).__name__}")
        if out.dtype != np.float32 or not out.flags.carray or out.shape[1:] != (self.channels,):
            raise ValueError(f"out must be float32 [frames, {self.channels}], contiguous and writeable")
        player: Player | None = self
        while player is not None:
            if player._successor is None or not player.is_over:
                player._parameters.before_block(len(out))
            player = player._successor
        kernel_of_memory(PLAY_INTO)(self.memory.address, out.ctypes.data, len(out))

    def leave_to_device(self) -> None:
        """Let a device render from now on: nothing waits for the tables that `set` asks for."""
        self._parameters.leave_to(None)

    @property
    def frame(self) -> int:
        """Frames played so far, by this player itself."""
        return int(self.counters[Slot.FRAME])

    @property
    def finished(self) -> bool:
        """True if all has been played, by this player and by its successors."""
        return bool(self.counters[Slot.FINISHED]) and (self._successor is None or self._successor.finished)

    @property
    def successor(self) -> "Player | None":
        """The player that took over."""
        return self._successor

    @property
    def is_over(self) -> bool:
        """True if this player has fallen silent, whatever its successor does."""
        return bool(self.counters[Slot.FINISHED])

    @property
    def driver_stopped(self) -> bool:
        """True if the driver has been told to stop."""
        return self.finished or (bool(self.counters[Slot.FINISHED]) and not self.counters[Slot.SUCCESSOR])

    def stop(self) -> None:
        """Fade out, and end; so does the player that took over."""
        self.counters[Slot.STOP_REQUESTED] = 1
        if self._successor is not None:
            self._successor.stop()

    def cross_fade_to(self, following: "Player") -> None:
        """Let another player take over: one sound fades into the other. From then on, events and parameters are those
        of the other player, which has a log of its own; `read`, `finished` and `stop` go on for both. Raises TypeError
        if it is no player, ValueError if it has other channels, or plays already."""
        if not isinstance(following, Player):
            raise TypeError(f"{following!r} is not a player; give one, such as fdh.Player(scene)")
        if following is self or following.frame > 0 or following._successor is not None:
            raise ValueError("this player plays already; give another one")
        if (following.channels, following.samplerate) != (self.channels, self.samplerate):
            wrong, right = (f"{p.channels} channels at {p.samplerate} Hz" for p in (following, self))
            raise ValueError(f"it has {wrong}, not {right}; stop and start again")
        frames = nearest_frame(CROSS_FADE_SECONDS, self.samplerate)
        if self.counters[Slot.STOP_REQUESTED] or self.frame + frames >= self.counters[Slot.END]:
            raise ValueError("playing has ended")
        self.counters[Slot.FADE_OUT_FRAMES] = following.counters[Slot.FADE_IN_FRAMES] = frames
        self._successor = following
        following._parameters.leave_to(self._parameters.renderer)
        self.counters[Slot.SUCCESSOR] = following.memory.address

    def let_go(self) -> None:
        """Free what the players are made of that have fallen silent, and after which others took over: call it now and
        then, at least a block after that."""
        player, is_first = self, True
        while player._successor is not None and player.is_over:
            if player._is_over_since is None:
                player._is_over_since = time.monotonic()
            elif player.memory.is_held and time.monotonic() - player._is_over_since > LET_GO_SECONDS:
                player.memory.let_go(is_first)
                for name in (*BUILT_WITH_PLAYER, *(() if player.options.log else ("patch",))):
                    player.__dict__.pop(name, None)
            player, is_first = player._successor, False

    def fetch_recording(self) -> np.ndarray:
        """Return the sound played since the last call, by this player and by its successors, in single precision
        [frames, channels]; at most the last RECORD_SECONDS (engine.live.audio_memory)."""
        record, until = self.memory.shared.record, int(self.counters[Slot.RECORDED])
        begin = max(self._fetched, until - len(record))
        audio = record[np.arange(begin, until) % len(record)]
        overrun = max(0, int(self.counters[Slot.RECORDED]) - len(record) - begin)  # written over meanwhile
        self.lost_frames += begin - self._fetched + min(overrun, len(audio))
        self._fetched = until
        return audio[overrun:]

    # --- events

    def strike(
        self, body: str | None = None, velocity: float | None = None, displacement: float | None = None, frame: int = 0
    ) -> None:
        """Launch a hammer again; if none is named, launch every hammer and repeat every pluck under [[force]]. It lifts
        the dampers of what it touches, as a key does.

        velocity, displacement: m/s and m; as at time 0 if None
        frame: when, at the earliest
        Raises KeyError if there is no such mass or oscillator.
        """
        if body is None:
            for name in self.strikers:
                self.strike(name, velocity, displacement, frame)
            for name in self.rows.plucked_at_first:
                self.pluck(name, frame=frame)
            return
        self._put(["strike", body], self.rows.strike(body, velocity, displacement), frame)

    def pluck(self, body: str, scale: float = 1.0, frame: int = 0, places: Sequence[int] | None = None) -> None:
        """Pluck a body again, by its forces that are over after a while, so many times as strong; and lift its dampers.
        Plucks leave each other alone, however near they are.

        places: which of these forces, in the order of the patch, from 0; all if None

        Raises KeyError if there is none such, ValueError if `scale` is not above 0."""
        rows = self.rows.pluck(body, scale, places)
        self.lift(body, frame)
        for row in rows:
            self._put(["pluck", body], [row], frame)

    def play_event(self, event: Event, frame: int = 0, note: int = 0, is_release: bool = False) -> None:
        """Let an event of a patch happen at a frame, in place of its time. It does what it says, and no more: a strike
        or a pluck lifts no dampers.

        note:       it is cancelled if it has not begun when this note is cancelled; 0: it belongs to none
        is_release: it ends a note, and is never dropped
        """
        if isinstance(event, ChangeEvent):
            section = next((name for name in GLIDED_KEYS if getattr(event, name) is not None), "parameter")
            name = event.parameter if section == "parameter" else getattr(event, section)
            values = {key: getattr(event, key) for key in GLIDED_KEYS.get(section, ())}
            named = {f"{section}.{name}.{key}": value for key, value in values.items() if value is not None}
            for parameter, value in (named or {str(name): event.value}).items():
                self._change(parameter, value or 0.0, event.duration, frame, note, is_release)
            return
        rows = self.rows.of_event(event.model_copy(update={"time": 0.0}))
        self._put([event.kind, event.body], rows, frame, note, is_release)

    def play_sets(self, description: list[Any], sets: Sequence[RowSet], frame: int = 0) -> None:
        """Let sets of events that end notes begin at a frame, as one event of the queue. description: for the log"""
        self._queue.put_group(description, sets, frame)

    def cancel(self, note: int, frame: int = 0) -> None:
        """Forget the events of a note that have not begun before a frame, and its changes of tables."""
        self._parameters.cancel(note, checked_frame(frame))
        self._put(["cancel", note], [EventRow(EventKind.CANCEL, 0, 0, 0, 0, 0)], frame, note, is_release=True)

    def lift(self, body: str, frame: int = 0) -> None:
        """Lift the dampers of a body; one that is to come down for good, by the score, stays up."""
        self._put(["lift", body], self.rows.lift(body), frame, is_release=True)

    def damp(
        self, body: str | None = None, sigma: float = MUTE_SIGMA, seconds: float = MUTE_SECONDS, frame: int = 0
    ) -> None:
        """Damp a body for a while, or all that vibrate. sigma: extra decay rate, 1/s."""
        names = [body] if body is not None else [b.name for b in self.scene.body if not isinstance(b, Mass)]
        duration = checked_number("seconds", seconds)
        for name in names:
            self._put(["damp", name], self.rows.damp(name, sigma, duration), frame, is_release=True)

    def set(
        self,
        parameter: str | Mapping[str, float],
        value: float | None = None,
        seconds: float = GLIDE_SECONDS,
        frame: int = 0,
    ) -> None:
        """Set a live parameter: one of `live_parameters`, such as `contact.NAME.stiffness`, `body.NAME.tension` or
        `pickup.0.gain`. The value glides. The energy balance includes the change, so the sound cannot blow up.

        Some parameters, such as a tension, need new coefficients, and glide when these have been computed. The next
        block waits for them if the thread that renders has called `set`. Otherwise they are computed in the background,
        in milliseconds to seconds; if a parameter is set again meanwhile, its last value counts.

        parameter: a path; or several and their values, as {parameter: value}, whose coefficients are computed together
        Raises KeyError if there is no such parameter, ValueError (BuildError) if it cannot have that value, or a value
        is given beside those of a dict; TypeError if there is none. A value that turns out to be impossible later is in
        `refused` and in the log, and the parameter keeps its old value."""
        values = values_by_path(parameter, value)
        chosen = [self._parameters.checked_value(name, one) for name, one in values.items()]
        duration, frame = checked_number("seconds", seconds), checked_frame(frame)
        for path, name, one in chosen:
            if path.is_glided:
                self._glide(NewValue(path, name, one), duration, frame)
        if tabled := [new for new in chosen if not new.path.is_glided]:
            self._plan(tabled, duration, frame)

    def _change(self, parameter: str, value: float, seconds: float, frame: int, note: int, is_release: bool) -> None:
        """Do what `set` does, as a part of a note."""
        new = self._parameters.checked_value(parameter, value)
        if new.path.is_glided:
            self._glide(new, seconds, frame, note, is_release)
        else:
            self._plan([new], seconds, checked_frame(frame), note)

    def _plan(self, values: list[NewValue], seconds: float, frame: int, note: int = 0) -> None:
        """Let parameters change that tables are made of."""
        self._parameters.put(values, seconds, frame, note)

    def _glide(self, new: NewValue, seconds: float, frame: int, note: int = 0, is_release: bool = False) -> None:
        """Let a parameter glide in the audio thread."""
        rows = self.rows.change(new.path, new.parameter, new.value, seconds)
        self._put([new.parameter, new.value], rows, frame, note, is_release)
        self._parameters.keep(new.parameter, new.value)

    def make_tables(self) -> None:
        """Compute all coefficients that `set` has requested, and wait until this is done."""
        self._parameters.make_tables()

    @property
    def refused(self) -> dict[str, str]:
        """Parameters whose last value turned out to be impossible, and the reasons."""
        return self._parameters.refused

    def value(self, parameter: str) -> float:
        """The value of a live parameter: where it glides to. Raises KeyError if there is no such parameter."""
        return self._parameters.value(parameter)

    def tune(self, voice: int, ratio: float, frame: int = 0, seconds: float = 0.0, body: str | None = None) -> None:
        """Give a voice another pitch at a frame, at once or gliding there in steps; what that does to its energy is
        accounted for. To prepare a step takes some milliseconds, and a glide begins when all are.

        ratio: of the frequencies to those of the patch
        body:  tune this body of the patch and the bodies that contacts join to it; else all bodies that sound
        Raises IndexError without such a voice, KeyError without such a body, ValueError below the lowest pitch,
        BuildError (a ValueError) if it would vibrate too fast; nothing has changed then."""
        self._tuning.tune(voice, ratio, frame, seconds, body)

    @property
    def strikers(self) -> list[str]:
        """Masses and oscillators that are thrown, at first or by an event; of all voices."""
        return self.rows.strikers

    @property
    def plucked(self) -> list[str]:
        """Bodies that `pluck` can pluck; of all voices."""
        return self.rows.plucked

    @property
    def live_parameters(self) -> list[str]:
        """Paths that `set` can change."""
        return list(self.live_paths)

    @cached_property
    def live_paths(self) -> dict[str, LivePath]:
        """The live parameters that `set` can change, by path. Voices are tuned with `tune` instead."""
        changes = any(isinstance(event, ChangeEvent) and event.exponent is not None for event in self.scene.event)
        paths = live_paths(self.scene, self.options.general or changes)
        if self.voices:
            return {name: path for name, path in paths.items() if path.is_glided or path.is_level}
        return paths

    def default_velocity(self, striker: str) -> float:
        """Velocity at which a hammer is thrown at time 0, or else first, m/s."""
        return self.rows.default_velocity(striker)

    def _put(
        self, description: list[Any], rows: list[EventRow], frame: int, note: int = 0, is_release: bool = False
    ) -> None:
        for row in rows:
            self._queue.put(list(description), row._replace(start=frame, note=note, is_release=is_release))

    def queue_unlogged(self, row: EventRow, sets: Sequence[RowSet] = ()) -> None:
        """Put an event into the queue that is in no log. sets: of a group"""
        if row.kind == EventKind.GROUP:
            self._queue.put_group([], sets, row.start, is_logged=False)
        else:
            self._queue.put_unlogged(row)

    # --- what it says of itself

    def log(self) -> dict[str, Any]:
        """All that was done, as JSON can hold it; `engine.live.replay` makes the same sound of it. It has the log of a
        player that took over. Raises RuntimeError if the player was made with `log = False`, or `let_go` freed it."""
        if not self.options.log:
            raise RuntimeError("the player keeps no log, as it was made with log = False")
        if not self.memory.is_held:
            raise RuntimeError("the log was let go with the player; a LogFile keeps it")
        following = {} if self._successor is None else {"next": self._successor.log()}
        return self.log_head() | self.log_tail() | {"events": self.log_entries()} | following

    def log_head(self) -> dict[str, Any]:
        """The part of a log that is known from the beginning: the scene, its tables by their digest, and settings."""
        scene = json.loads(self.patch.model_dump_json(exclude_none=True))
        settings = {"scene": scene, "samplerate": self.samplerate, "gain": self.gain}
        settings |= {"table_digest": self.table_digest}
        return settings | {name: getattr(self.options, name) for name in ("voices", "lowest", "general", "waiting")}

    def log_tail(self) -> dict[str, int]:
        """The part of a log that is known at the end: frames that were played, and those of fades."""
        ends = {"end": Slot.END, "fade": Slot.FADE_IN_FRAMES, "leave": Slot.FADE_OUT_FRAMES}
        return {"frames": self.frame} | {name: int(self.counters[slot]) for name, slot in ends.items()}

    def log_entries(self) -> list[dict[str, Any]]:
        """The events of the log, without those that were taken."""
        return self._queue.entries()

    def take_entries(self) -> list[dict[str, Any]]:
        """Take the part of the log that nothing changes any more, to be written to a file."""
        return self._queue.take_entries()

    def meter(self) -> MeterReading:
        """Read the meter: `meter()["energy_error"]`, or `meter().energy_error`; `meter().as_dict()` has all.

        peak:         largest sample since the last reading, before the limiter; full scale = 1
        limited:      samples that the limiter reduced
        capped:       samples whose error is larger than `max_error`, because live sound has 64 steps per sample at most
        not_finite:   samples that were not finite, and are silent
        dropped:      events that were dropped, because there were too many at once
        energy_error: largest error of the energy balance, relative to the maximum stored energy
        quality:      0 is full quality, -1 and below are reduced
        worst_block:  time of the costliest block, relative to its deadline; 0 without a device
        dropouts:     blocks that the device did not get in time; 0 without a device
        """
        gauges, counters = self.gauges, self.counters
        spent, peak = float(gauges[Gauge.SECONDS_USED]), float(gauges[Gauge.PEAK])
        gauges[Gauge.PEAK] = 0.0
        seconds = self.frame / self.samplerate
        awake = self.state.sleep[:, Sleep.WAKE_FRAME] <= self.frame
        return MeterReading(
            seconds=seconds,
            peak=peak,
            real_time_factor=seconds / spent if spent > 0.0 else math.inf,
            worst_block=float(gauges[Gauge.MAX_LOAD]),
            dropouts=int(counters[Slot.UNDERRUNS]),
            limited=int(counters[Slot.LIMITED_SAMPLES]),
            capped=capped_samples(self.state),
            not_finite=int(counters[Slot.NONFINITE_SAMPLES]),
            dropped=self._queue.dropped(),
            lost=self.lost_frames,
            newton=newton_statistics(self.model, self.state),
            energy_error=energy_statistics(self.memory.job_memory.balance, self.state.energy_totals).error_max,
            quality_steps=int(counters[Slot.QUALITY_CHANGES]),
            quality=-int(counters[Slot.QUALITY]),
            awake=int(np.sum(awake)),
            islands=len(awake),
            voices=self.voices,
            sounding=int(np.sum(awake.reshape(self.voices or 1, -1).any(axis=1))),
            kernel=self.memory.kernel,
            table_digest=self.table_digest,
        )
