"""The controls of a patch: moves of MIDI controllers and numbers of OSC become values of live parameters.

A move is remembered, and a step towards it is made when `poll` is called: however fast moves come, the last one counts,
and the audio thread gets one event for each parameter and step.
"""

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from engine.instrument.held_keys import ALL
from engine.live.midi_notes import Move
from engine.live.player import Player
from engine.patch.control_rules import paths_of_keys
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.wording import to_one_line

CONTROL_STEP_SECONDS = 0.005  # between two steps of a control, at least …
MAX_STEP_SECONDS = 0.05  # … and how long the sound takes for one at most
MAX_UNKNOWN, MAX_ADDRESS_CHARACTERS = 100, 60  # addresses that are counted; and shown of each
CLOSE = 1e-4  # of the way: what is nearer has arrived

Targets = Callable[[Player, str], list[str]]  # the live parameters of a player that a path of the patch stands for
Origin = tuple[int, int]  # of a move: its channel, and the key of a pressure of one key; 0 of all
OSC_ORIGIN: Origin = (ALL, 0)


@dataclass
class Course:
    """The progress of a live parameter from its old value to the one that a control gives it. Shares: 0 at the low end
    of the control's range, 1 at the high."""

    control: Any
    path: str
    share: float
    target: float
    origin: Origin  # of the last move


class Controls:
    """The controls of a patch, and a player that they act on. Moves may come from any thread; one calls `poll`.

    Where a file moves controls, it calls `advance`: its moves are known before their time.
    """

    def __init__(self, scene: Scene, player: Player) -> None:
        self.refused: dict[str, str] = {}  # parameters that could not have a value, and why
        self.unknown: dict[str, int] = {}  # addresses that nothing belongs to, and how often they came
        self._lock = threading.Lock()
        self._given: dict[str, tuple[float, float]] = {}  # values that parameters were given, and those of the patch
        self._courses: dict[tuple[int, str], Course] = {}  # by control and live parameter
        self._latest: dict[tuple[int, Origin], float] = {}  # move of each control on each channel, the last one last
        self._is_ahead = False  # whether a file moves the controls of MIDI
        self._direct: dict[str, float] = {}
        self.use(scene, player)

    def use(self, scene: Scene, player: Player) -> None:
        """Act on another player, as that of an edited patch. It gets the values that the controls have given, but where
        the edit gives another one."""
        given, self._given = self._given, {}
        with self._lock:
            before = list(self._courses.values())
            self.scene, self.player = scene, player
            self._step_frames = frame_count(CONTROL_STEP_SECONDS, player.samplerate)
            self._polled, self._advanced = player.frame - self._step_frames, -self._step_frames
            self._courses = {}
            self._direct = {path: value for path, value in self._direct.items() if path in player.live_paths}
            self._addresses = {"/" + path.replace(".", "/"): path for path in player.live_parameters}
        for path, (value, of_patch) in given.items():
            if path in player.live_paths and player.value(path) == of_patch:
                self._set([path], value, 0.0)
        for course in before:  # moves under way go on
            if course.share != course.target and course.control in scene.control and course.path in player.live_paths:
                self._aim(scene.control.index(course.control), [course.path], course.target, course.origin)

    def forget(self, paths: Iterable[str]) -> None:
        """Forget the values of some parameters, to which an edit of the patch gave others."""
        for path in paths:
            self._given.pop(path, None)

    def takes(self, move: Move) -> bool:
        """True if a move of a MIDI controller changes a parameter."""
        return any(takes_move(control, move) for control in self.scene.control)

    def has_address(self, address: str) -> bool:
        """True if a control has this OSC address."""
        return any(control.kind == "osc" and control.address == address for control in self.scene.control)

    def move(self, move: Move, notes: Targets | None = None) -> None:
        """Remember a move of MIDI. notes: the targets of the notes that it is of, if it is not of all"""
        origin = move.channel, move.number if move.kind == "poly_pressure" else 0
        for i, control in enumerate(self.scene.control):
            if takes_move(control, move):
                self._latest.pop((i, origin), None)
                self._latest[i, origin] = move.value
                paths = (notes or targets_of_all)(self.player, control.parameter)
                if paths or notes is None:  # a key that sounds nothing changes nothing
                    self._aim(i, paths, move.value, origin)

    def begin_note(self, notes: Targets, channels: tuple[int, ...], key: int, frame: int) -> None:
        """Let a note begin with what the controllers of its channels say; where they have not moved, with the values of
        the patch. What its channels have moved last goes on as it does.

        notes: its targets; channels: that it follows; frame: at which it begins
        """
        for i, control in enumerate(self.scene.control):
            if control.kind == "osc":
                continue
            mine = {(channel, number) for channel in channels for number in (0, key)}
            moved = [(origin, share) for (n, origin), share in self._latest.items() if n == i and origin in mine]
            for path in notes(self.player, control.parameter):
                with self._lock:
                    course = self._courses.get((i, path))
                    if moved and (course is None or course.origin != moved[-1][0]):
                        origin, share = moved[-1]
                        self._courses[i, path] = Course(control, path, share, share, origin)
                        value = value_of(control, share)
                    elif not moved and course is not None:
                        del self._courses[i, path]
                        value = self._given[path][1] if path in self._given else self.player.value(path)
                    else:
                        continue
                self._set([path], value, 0.0, frame)

    def knows(self, address: str) -> bool:
        """True if an OSC address is that of a control or of a live parameter."""
        return self.has_address(address) or address in self._addresses

    def receive(self, address: str, value: float) -> None:
        """Remember a number of OSC: of a control with this address; or the address is the path of a live parameter,
        as `/contact/felt/stiffness`, and the number its value."""
        path = self._addresses.get(address)
        controls = [(i, c) for i, c in enumerate(self.scene.control) if c.kind == "osc" and c.address == address]
        for i, control in controls:
            low, high = control.input
            share = min(1.0, max(0.0, (value - low) / (high - low)))
            self._aim(i, targets_of_all(self.player, control.parameter), share, OSC_ORIGIN)
        if not controls and path is not None:
            with self._lock:
                self._direct[path] = value
        elif not controls:
            self.count_unknown(address)

    def set_at(self, address: str, value: float, frame: int) -> bool:
        """Set the live parameter of an address at a frame; False if a control has this address, which has a course."""
        if self.has_address(address) or address not in self._addresses:
            return False
        self._set([self._addresses[address]], value, CONTROL_STEP_SECONDS, frame)
        return True

    def count_unknown(self, address: str) -> None:
        """Count a message to an address that nothing belongs to."""
        shown = to_one_line(address, MAX_ADDRESS_CHARACTERS)
        with self._lock:
            if shown in self.unknown or len(self.unknown) < MAX_UNKNOWN:
                self.unknown[shown] = self.unknown.get(shown, 0) + 1

    def poll(self) -> None:
        """Make the steps that are due."""
        now = self.player.frame
        if now - self._polled < self._step_frames:
            return
        passed = min(MAX_STEP_SECONDS, (now - self._polled) / self.player.samplerate)
        self._polled = now
        self._step(passed, 0, is_ahead=False)
        with self._lock:
            direct, self._direct = self._direct, {}
        for path, value in direct.items():
            self._set([path], value, passed)
        self.refused = self.player.refused | self.refused

    def advance(self, frame: int) -> None:
        """Make the steps up to a frame that the moves of a file cause, each at its own frame."""
        self._is_ahead = True
        while self._advanced + self._step_frames <= frame:
            self._advanced += self._step_frames
            self._step(self._step_frames / self.player.samplerate, self._advanced, is_ahead=True)

    def _step(self, seconds: float, frame: int, is_ahead: bool) -> None:
        """Make a step of the controls that a file moves, or of the others."""
        with self._lock:
            moving = [
                course
                for course in self._courses.items()
                if course[1].share != course[1].target
                and (self._is_ahead and course[1].control.kind != "osc") == is_ahead
            ]
            for _, course in moving:
                course.share = approach(course.share, course.target, seconds, course.control.smoothing)
        for key, course in moving:
            if self._courses.get(key) is course:  # no note of another channel has begun meanwhile
                self._set([course.path], value_of(course.control, course.share), seconds, frame)

    def _aim(self, number: int, paths: list[str], target: float, origin: Origin) -> None:
        if not paths:
            control = self.scene.control[number]
            self.refused.setdefault(control.parameter, "it cannot change while the patch plays")
            return
        with self._lock:
            for path in paths:
                if (number, path) not in self._courses:
                    control = self.scene.control[number]
                    share = share_of(control, self.player.value(path))
                    self._courses[number, path] = Course(control, path, share, target, origin)
                course = self._courses[number, path]
                course.target, course.origin = target, origin

    def _set(self, paths: Iterable[str], value: float, seconds: float, frame: int = 0) -> None:
        for path in paths:
            try:
                of_patch = self._given[path][1] if path in self._given else self.player.value(path)
                self.player.set(path, value, seconds, frame)
                self._given[path] = value, of_patch
            except (ValueError, KeyError) as error:
                self.refused.setdefault(path, str(error))

    def remarks(self) -> list[str]:
        """Return the lines for the summary: refused values and unknown addresses."""
        self.refused = self.player.refused | self.refused
        lines = [f"{path}: {reason}" for path, reason in self.refused.items()]
        unknown = ", ".join(f"{address} ({count} times)" for address, count in list(self.unknown.items())[:10])
        return lines + ([f"OSC: no control or live parameter belongs to {unknown}"] if unknown else [])


def takes_move(control: Any, move: Move) -> bool:
    """True if a control follows a move of a MIDI controller."""
    if control.kind != move.kind or control.channel not in (None, move.channel):
        return False
    return bool(control.kind != "cc" or control.number == move.number)


def targets_of_all(player: Player, parameter: str) -> list[str]:
    """The live parameters that a path of the patch stands for: of all keys, or all voices."""
    if player.voices:
        return [path for n in range(player.voices) for path in targets_of_voice(player, parameter, n)]
    return paths_of_keys(player.live_paths, parameter)


def targets_of_voice(player: Player, parameter: str, voice: int) -> list[str]:
    """The live parameter of a voice that a path of the patch stands for; none if voices have none."""
    section, _, rest = parameter.partition(".")
    name, _, keys = rest.partition(".")
    if name.isdecimal():
        name = str(int(name) + voice * len(getattr(player.patch, section, [])))
    else:
        name = f"{name}_{voice}"
    path = f"{section}.{name}.{keys}"
    return [path] if path in player.live_paths else []


def approach(share: float, target: float, seconds: float, smoothing: float) -> float:
    """Return the share after some time on its way to a target; 63 % of the way takes the smoothing time."""
    if smoothing <= 0.0:
        return target
    share = target + (share - target) * math.exp(-seconds / smoothing)
    return target if abs(share - target) < CLOSE else share


def value_of(control: Any, share: float) -> float:
    """The value of a parameter at a share of a control's range."""
    low, high = control.range
    if share in (0.0, 1.0):
        return float(high if share else low)
    if control.curve == "exponential":
        return float(low * (high / low) ** share)
    return float(low + (high - low) * share)


def share_of(control: Any, value: float) -> float:
    """The share of a control's range at which a parameter has a value, within 0 to 1."""
    low, high = control.range
    if low == high:
        return 0.0
    if control.curve == "exponential":
        share = math.log(value / low) / math.log(high / low) if value / low > 0.0 else 0.0
    else:
        share = (value - low) / (high - low)
    return min(1.0, max(0.0, share))
