"""A scene that is played while events come: strikes, plucks, dampers, knobs.

    player = Player(engine.load("patches/piano_c4.toml"), gain=0.1)
    stream = engine.sound.stream(player, None, 256, None)
    stream.start()
    player.strike("hammer", velocity=3.0)
    player.set("contact.felt.stiffness", 1e9)

Events go through a ring to the audio thread, which never waits for Python, and are kept in a log; a replay of the log
gives the same samples, bit for bit.
"""

import json
import math
import threading
from typing import Any

import numpy as np
from pydantic import ValidationError

from engine import deck, energy, post, score
from engine.block import block
from engine.build import BuildError, base, build
from engine.events import LIFT, NEVER, THROW
from engine.held import Held
from engine.jit import pointer
from engine.laws import Power
from engine.model import Model, Room, aligned
from engine.offline import newton
from engine.params import knobs
from engine.parts import Change, Constant, Damp, Mass, Oscillator, Pluck, PluckAgain, Samples, Strike
from engine.rest import UNTIL
from engine.scene import Scene, joined
from engine.stages import refinement
from engine.voices import copies, polyphonic, thrown, tuned

FADE = 0.005  # s
CROSSFADE = 0.02  # s
SIZE = 1024  # frames computed at once
ROOM = 64  # events at a time on each island
SLOTS = 1024  # of the ring
TIMED = 8192  # blocks whose times are kept
KEPT = 20.0  # s of what was played, until it is fetched
GLIDE = 0.02  # s, of a knob
STAIR, FINE = 0.002, 2.0  # s and cents, the smallest steps in which a pitch glides …
STAIRS = 128  # … and how many they are at most
NEAR, FAR = 0.8, 0.4  # of its deadline: a block that takes more lowers the quality, one that takes less is at ease
MUTE = 40.0, 0.4  # decay rate, 1/s, and how long, s
FOREVER = 1 << 60
LARGEST = 1 << 40  # frames that are played if a scene goes on and on


class Player:
    """A scene, ready to be played.

    seconds: until it fades out; the scene's own if None; `math.inf`: until it is stopped
    gain:    factor on SI units
    voices:  play so many copies of the scene, each of which can be tuned; none if 0
    lowest:  ratio of the lowest pitch they will be tuned to
    general: exponents can be turned; the contact laws are then general ones, which take longer
    Raises BuildError as `engine.build.build`.
    """

    def __init__(
        self,
        scene: Scene,
        samplerate: int = 44_100,
        seconds: float | None = None,
        gain: float = 1.0,
        voices: int = 0,
        lowest: float = 1.0,
        general: bool = False,
    ) -> None:
        if not math.isfinite(gain):
            raise ValueError(f"gain = {gain} is no factor")
        if scene.accuracy.oversample > 1:
            raise BuildError([("accuracy.oversample", "live sound is not oversampled; order, substeps, or render it")])
        self.patch, self.voices, self.lowest, self.general = scene, voices, lowest, general
        self._tunings: dict[tuple[int, float, str | None], tuple[np.ndarray, Model]] = {}
        self._pitch: list[tuple[float, str | None]] = [(lowest, None)] * voices
        if voices:
            plain = scene.accuracy.but(order=2, substeps=1, precision="float64")  # a voice is tuned table by table
            scene = polyphonic(tuned(scene, lowest), voices).model_copy(update={"accuracy": plain})
        self.scene, self.samplerate, self.gain = scene, samplerate, gain
        self.channels = max(p.channel for p in scene.pickup)
        self.model, self.state, self.layout = build(scene, samplerate, room=ROOM, general=general)
        if voices and self.model.force is not None:
            self.model.force.start[:] = NEVER  # until it is plucked
        parts = self.model.islands.part.size - 1
        rooms = [Room(np.zeros((SIZE, self.channels)), np.zeros((SIZE, energy.COLUMNS)), None) for _ in range(parts)]
        levels = self._levels()
        held = Held(self.model), Held(self.state)
        models = [held[0], *map(Held, levels)]
        self._models = np.array([m.address for m in models], np.int64)
        self._order = np.zeros(deck.EVENT, np.int64)
        self._changes = np.zeros((SLOTS, 2), np.int64)
        places = [Held(room) for room in rooms]
        self._events = np.zeros((SLOTS, deck.EVENT), np.int64)
        self._tunes = np.zeros((SLOTS, deck.EVENT), np.int64)  # that wait for their frame
        self._values = np.zeros((SLOTS, deck.VALUE))
        self._mix = np.zeros((SIZE, self.channels))
        self._record = np.zeros((round(KEPT * samplerate), self.channels), np.float32)
        self.times = np.zeros(TIMED)  # of the last blocks, as shares of their deadlines
        self._spare = np.zeros((SIZE, self.channels), np.float32)
        self._fetched = self.lost = 0
        tables = [[p.address for p in places], [r.out.ctypes.data for r in rooms]]
        tables.append([r.ledger.ctypes.data for r in rooms if r.ledger is not None])
        self._tables = [np.array(table, np.int64) for table in tables]
        self.gauge = np.zeros(deck.GAUGES)
        self.gauge[deck.GAIN], self.gauge[deck.NEAR], self.gauge[deck.FAR] = gain, NEAR, FAR
        seconds = scene.seconds if seconds is None else seconds
        self.desk = np.zeros(deck.DESK, np.int64)
        deck.put_in(self.desk.ctypes.data, 0, 0, 0, 0, 0, 0, 0.0, 0.0)  # compiles; there is no room yet
        self._set_out(
            BLOCK=pointer(block, *held, places[0], 0, 0),
            POST=pointer(post.post, *held, 0, 0, 0),
            MODEL=held[0].address,
            STATE=held[1].address,
            PARTS=parts,
            CHANNELS=self.channels,
            SIZE=SIZE,
            ROOMS=self._tables[0].ctypes.data,
            OUTS=self._tables[1].ctypes.data,
            LEDGERS=self._tables[2].ctypes.data,
            MIX=self._mix.ctypes.data,
            EVENTS=self._events.ctypes.data,
            VALUES=self._values.ctypes.data,
            SLOTS=SLOTS,
            TUNINGS=self._tunes.ctypes.data,
            RECORD=self._record.ctypes.data,
            KEPT=len(self._record),
            SPARE=self._spare.ctypes.data,
            MODELS=self._models.ctypes.data,
            LEVELS=len(models),
            LOWEST=len(models) - 1 + self.model.islands.mode.size - 2,
            ORDER=self._order.ctypes.data,
            CHANGES=self._changes.ctypes.data,
            CHANGED=SLOTS,
            TIMES=self.times.ctypes.data,
            TIMED=TIMED,
            GAUGE=self.gauge.ctypes.data,
            FADE=max(1, round(FADE * samplerate)),
            LEAVE=max(1, round(FADE * samplerate)),
            RATE=samplerate,
            END=LARGEST if math.isinf(seconds) else max(1, round(seconds * samplerate)),
        )
        self._kept_alive = models, held, places, rooms
        self.play(np.zeros((0, self.channels), np.float32))  # compiles
        deck.note(self.desk.ctypes.data, 1, 0.0)
        self.desk[deck.CALLS] = 0
        self._next: Player | None = None  # who took over
        self._log: list[dict[str, Any]] = []  # events as they were put in, then with the frame they were taken at
        self._lock, self._stepped = threading.Lock(), 0
        self._waiting: list[tuple[int, dict[str, Any]]] = []

    def _levels(self) -> list[Model]:
        """Coarser models of the same kind, to step down to where blocks come near their deadline."""
        accuracy = self.scene.accuracy
        if self.model.refinement is None or accuracy.precision == "float32":
            return []
        tables = (
            refinement(self.layout, self.model.modes, coarse, self.samplerate) for coarse in accuracy.coarser()[1:]
        )
        return [self.model._replace(refinement=aligned(table)) for table in tables]

    def _set_out(self, **numbers: int) -> None:
        for name, number in numbers.items():
            self.desk[getattr(deck, name)] = number

    # --- playing

    def play(self, out: np.ndarray) -> None:
        """Play the next len(out) frames into out, single precision [frames, channels]."""
        if out.dtype != np.float32 or not out.flags.c_contiguous or out.shape[1:] != (self.channels,):
            raise ValueError(f"out must be float32 [frames, {self.channels}], contiguous")
        deck.play(self.desk.ctypes.data, out.ctypes.data, len(out))

    @property
    def frame(self) -> int:
        """Frames played so far."""
        return int(self.desk[deck.FRAME])

    @property
    def over(self) -> bool:
        """Whether all has been played, by this player and by those that took over."""
        return bool(self.desk[deck.DONE]) and (self._next is None or self._next.over)

    @property
    def ended(self) -> bool:
        """Whether the driver was told that all is over."""
        return self.over or (bool(self.desk[deck.DONE]) and not self.desk[deck.NEXT])

    def stop(self) -> None:
        """Fade out, and end."""
        self.desk[deck.STOP] = 1

    def hand_over(self, following: "Player") -> None:
        """Let another player take over: one sound fades into the other. Raises ValueError if it has other channels."""
        if (following.channels, following.samplerate) != (self.channels, self.samplerate):
            raise ValueError(f"it has {following.channels} channels instead of {self.channels}; start anew")
        frames = round(CROSSFADE * self.samplerate)
        if self.desk[deck.STOP] or self.frame + frames >= self.desk[deck.END]:
            raise ValueError("what was played is over")
        self.desk[deck.LEAVE] = following.desk[deck.FADE] = frames
        self._next = following
        self.desk[deck.NEXT] = following.desk.ctypes.data

    def fetch(self) -> np.ndarray:
        """What was played since the last call, by this player and by those that took over, single precision
        [frames, channels]; at most the last KEPT seconds."""
        until = int(self.desk[deck.RECORDED])
        begin = max(self._fetched, until - len(self._record))
        found = self._record[np.arange(begin, until) % len(self._record)]
        overrun = max(0, int(self.desk[deck.RECORDED]) - len(self._record) - begin)  # written over meanwhile
        self.lost += begin - self._fetched + min(overrun, len(found))
        self._fetched = until
        return found[overrun:]

    # --- events

    def strike(
        self, body: str | None = None, velocity: float | None = None, displacement: float | None = None, frame: int = 0
    ) -> None:
        """Throw a hammer, again; every hammer of the scene, and every pluck under [[force]], if none is named. It lifts
        the dampers of what it touches, as a key does.

        velocity, displacement: m/s and m; as at time 0 if None
        frame: when, at the earliest
        Raises KeyError if there is no such mass or oscillator.
        """
        if body is None:
            for name in self.hammers:
                self.strike(name, velocity, displacement, frame)
            for name in dict.fromkeys(f.body for f in self.layout.forces if isinstance(f, Pluck)):
                self.pluck(name, frame=frame)
            return
        hammer = self._body(body)
        if not isinstance(hammer, Mass | Oscillator):
            raise KeyError(f"{body} is no hammer; a mass or an oscillator is: {', '.join(self.hammers) or 'none here'}")
        speed = self.speed(body) if velocity is None else velocity
        told = Strike(kind="strike", time=0.0, body=body, velocity=speed, displacement=displacement)
        for island, start, end, _, *rest in score.rows_of(self.layout, told, base(self.layout), self.samplerate):
            self._put(("strike", body), (THROW, island, *rest[:2], frame, end - start, *rest[2:]))

    def pluck(self, body: str, scale: float = 1.0, frame: int = 0) -> None:
        """Pluck a body again, by its forces that are over after a while, so many times as strong; and lift its dampers.
        Raises KeyError if there is none such, ValueError if `scale` is not above 0."""
        if not 0.0 < scale <= 1e6:
            raise ValueError(f"scale = {scale:g} is out of range; more than 0, at most 1e6")
        self._body(body)
        forces = [(j, self.layout.forces[number]) for j, number in enumerate(self.layout.force)]
        chosen = [j for j, force in forces if force.body == body and not isinstance(force, Constant | Samples)]
        if not chosen:
            others = dict.fromkeys(f.body for _, f in forces if not isinstance(f, Constant | Samples))
            raise KeyError(f"nothing plucks {body}; of those that are plucked there are {', '.join(others) or 'none'}")
        self.lift(body, frame)
        island = self.layout.island[self.layout.number[body]]
        for j in chosen:
            self._put(("pluck", j), (post.PLUCK, island, j, j + 1, frame, 1, scale, 0.0))

    def lift(self, body: str, frame: int = 0) -> None:
        """Lift the dampers of a body; one that is to come down for good, by the score, stays up."""
        self._body(body)
        number = self.layout.number[body]
        modes, island = self.layout.modes_of(number), self.layout.island[number]
        self._put(("lift", body), (LIFT, island, modes.start, modes.stop, frame, 1, 0.0, 0.0))

    def damp(self, body: str | None = None, sigma: float = MUTE[0], seconds: float = MUTE[1], frame: int = 0) -> None:
        """Damp a body for a while, or all that vibrate. sigma: extra decay rate, 1/s."""
        names = [body] if body is not None else [b.name for b in self.scene.body if not isinstance(b, Mass)]
        for name in names:
            self._body(name)
            self._tell(("damp", name), Damp(kind="damp", time=0.0, body=name, sigma=sigma, duration=seconds), frame)

    def set(self, what: str, value: float, seconds: float = GLIDE, frame: int = 0) -> None:
        """Turn a knob: `contact.NAME.stiffness`, `.exponent`, `.barrier` or `.gap`. The value glides, and what that
        does to the energy is booked, so that it cannot blow up the sound. Raises KeyError if there is no such knob."""
        if what not in self.knobs:
            raise KeyError(f"no knob {what}; there are {', '.join(self.knobs) or 'none: give a contact a name'}")
        _, name, key = what.split(".")
        asked = {"kind": "change", "time": 0.0, "contact": name, "duration": seconds, key: value}
        try:
            told = Change.model_validate(asked)
        except ValidationError as error:
            raise ValueError(f"{what} = {value:g} is out of range; {error.errors()[0]['msg']}") from None
        self._tell((what, value), told, frame)

    def tune(self, voice: int, ratio: float, frame: int = 0, seconds: float = 0.0, body: str | None = None) -> None:
        """Give a voice another pitch at a frame, at once or gliding there in steps; what that does to its energy is
        booked. To prepare a step takes some milliseconds, and a glide begins when all are.

        ratio: of the frequencies to those of the patch
        body:  tune this body of the patch and what contacts join with it; else all that is heard
        Raises IndexError without such a voice, KeyError without such a body, ValueError below the lowest pitch,
        BuildError (a ValueError) if it would vibrate too fast; nothing has changed then."""
        if not 0 <= voice < self.voices:
            raise IndexError(f"no voice {voice}; there are {self.voices}")
        if ratio < self.lowest:  # it would have modes for which there is no room
            raise ValueError(f"ratio = {ratio:g} is out of range; at least {self.lowest:g}, the lowest it was made for")
        if len(self._tunings) > STAIRS and self.desk[deck.TAKEN] == self.desk[deck.PUT]:
            if self.desk[deck.WAITING] == 0:  # none of them is waited for
                self._tunings.clear()
        if body is not None and all(b.name != body for b in self.patch.body):
            raise KeyError(f"no body {body}; there are {', '.join(b.name for b in self.patch.body)}")
        before, what = self._pitch[voice]
        before = before if what == body else ratio  # from another body, nothing can glide
        cents = 1200.0 * abs(math.log2(ratio / before))
        steps = max(1, math.ceil(min(STAIRS, seconds / STAIR, cents / FINE)))
        ratios = [before * (ratio / before) ** (n / steps) for n in range(1, steps)] + [ratio]
        tables = [self._table(voice, one, body) for one in ratios]
        if seconds > 0.0:
            frame = max(frame, self.frame)
        islands = (len(self.state.asleep)) // self.voices
        for n, (one, table) in enumerate(zip(ratios, tables, strict=True), 1):
            there = frame + round(n * seconds / steps * self.samplerate)
            row = (deck.TUNE, voice * islands, len(table), islands, table.ctypes.data, there, 0.0, 0.0)
            self._put(("tune", voice, one, *([] if body is None else [body])), row)
        self._pitch[voice] = ratio, body

    def _table(self, voice: int, ratio: float, body: str | None) -> np.ndarray:
        """What has to be copied for a voice to have a pitch; kept, for the audio thread reads it."""
        key = voice, ratio, body
        if key not in self._tunings:
            scene = tuned(self.patch, ratio)
            if body is not None:
                heard = {p.body for p in self.patch.pickup}
                names = (joined(self.patch, body) & heard) | {body}
                scene = tuned(tuned(self.patch, self.lowest, heard - names), ratio, names)
            single = polyphonic(scene, 1).model_copy(update={"accuracy": self.scene.accuracy})
            model, _, layout = build(single, self.samplerate, room=ROOM, general=self.general)
            self._tunings[key] = copies((self.model, self.layout), (model, layout), voice), model
        return self._tunings[key][0]

    @property
    def hammers(self) -> list[str]:
        """Masses and oscillators that are thrown, at first or by an event; of all voices."""
        names = list(thrown(self.patch))
        return [f"{name}_{n}" for n in range(self.voices) for name in names] if self.voices else names

    @property
    def knobs(self) -> list[str]:
        """What `set` can turn."""
        contact = self.model.contact
        return knobs(self.scene, contact is not None and isinstance(contact.law, Power))

    def speed(self, hammer: str) -> float:
        """Velocity at which a hammer is thrown at time 0, or else first, m/s."""
        return thrown(self.patch).get(hammer.rpartition("_")[0] if self.voices else hammer, 0.0)

    def _body(self, name: str) -> Any:
        if name not in self.layout.number:
            raise KeyError(f"no body {name}; there are {', '.join(self.layout.number)}")
        return self.scene.body[self.layout.number[name]]

    def _tell(self, why: tuple[Any, ...], event: Strike | Damp | Change | PluckAgain, frame: int) -> None:
        for island, start, end, kind, first, last, a, b in score.rows_of(
            self.layout, event, base(self.layout), self.samplerate
        ):
            self._put(why, (kind, island, first, last, frame, min(end, FOREVER) - start, a, b))

    def _put(self, why: tuple[Any, ...], row: tuple[int, int, int, int, int, int, float, float]) -> None:
        """Put an event into the ring. While that is full, all one could do is wait: it is dropped, and that is said."""
        with self._lock:  # one at a time writes to the ring
            number = int(self.desk[deck.PUT])
            if deck.put_in(self.desk.ctypes.data, *row):
                self._waiting.append((number, {"why": list(why), "row": list(row)}))
            else:
                self._log.append({"frame": None, "why": [*why, "dropped: too many at once"], "row": list(row)})
            self._settle()

    def _settle(self) -> None:
        """Note the frame of events that have been taken, and the steps of quality."""
        taken, steps = int(self.desk[deck.TAKEN]), int(self.desk[deck.STEPS])
        for n in range(max(self._stepped, steps - SLOTS), steps):
            frame, level = self._changes[n % SLOTS].tolist()
            self._log.append(
                {"frame": frame, "why": ["quality", level], "row": [deck.QUALITY, 0, level, 0, 0, 0, 0.0, 0.0]}
            )
        self._stepped = steps
        while self._waiting and self._waiting[0][0] < taken:
            number, event = self._waiting.pop(0)
            frame = int(self._events[number % SLOTS, deck.TOOK])
            if frame == post.DROPPED:
                event["why"].append("dropped: too many on this island")
            self._log.append({"frame": None if frame == post.DROPPED else frame} | event)

    # --- what can be told

    def log(self) -> dict[str, Any]:
        """All that was done, as JSON can hold it; `replay` makes the same sound of it."""
        with self._lock:
            self._settle()
        scene = json.loads(self.patch.model_dump_json(exclude_none=True))
        told = {"scene": scene, "samplerate": self.samplerate, "gain": self.gain, "frames": self.frame}
        told |= {"voices": self.voices, "lowest": self.lowest, "general": self.general}
        told |= {name.lower(): int(self.desk[getattr(deck, name)]) for name in ("END", "FADE", "LEAVE")}
        # in the order in which they were done: steps of quality at the end of a block, events at the beginning of one
        events = sorted(self._log, key=lambda e: -1 if e["frame"] is None else e["frame"])
        return told | {"events": events}

    def meter(self) -> dict[str, Any]:
        """What a meter shows; peaks are since the last call."""
        with self._lock:
            self._settle()
        gauge, desk = self.gauge, self.desk
        spent, peak = float(gauge[deck.BUSY]), float(gauge[deck.PEAK])
        gauge[deck.PEAK] = 0.0
        seconds = self.frame / self.samplerate
        awake = self.state.asleep[:, UNTIL] <= self.frame
        return {
            "seconds": seconds,
            "peak": peak,
            "real_time_factor": seconds / spent if spent > 0.0 else math.inf,
            "worst_block": float(gauge[deck.WORST]),
            "dropouts": int(desk[deck.GAPS]),
            "limited": int(desk[deck.LIMITED]),
            "not_finite": int(desk[deck.WRONG]),
            "dropped": sum(e["frame"] is None for e in self._log),
            "lost": self.lost,
            "newton": newton(self.model, self.state),
            "energy_error": float(gauge[deck.ERROR] / (gauge[deck.ENERGY] or 1.0)),
            "quality_steps": int(desk[deck.STEPS]),
            "quality": -int(desk[deck.LEVEL]),
            "awake": int(np.sum(awake)),
            "islands": len(awake),
            "voices": self.voices,
            "sounding": int(np.sum(awake.reshape(self.voices or 1, -1).any(axis=1))),
        }
