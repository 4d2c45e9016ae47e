"""The controls of a patch: moves of MIDI controllers and numbers of OSC become values of live parameters.

A move is remembered, and a step towards it is made when `poll` is called: however fast moves come, the last one counts,
and the audio thread gets one event for each parameter and step.
"""

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from engine.live.midi_notes import Move
from engine.live.player import Player
from engine.patch.control_rules import paths_of_keys
from engine.patch.live_parameters import current_path
from engine.patch.scene import Scene
from engine.wording import to_one_line

CONTROL_STEP_SECONDS = 0.005  # between two steps of a control, at least …
MAX_STEP_SECONDS = 0.05  # … and how long the sound takes for one at most
MAX_UNKNOWN, MAX_ADDRESS_CHARACTERS = 100, 60  # addresses that are counted; and shown of each
CLOSE = 1e-4  # of the way: what is nearer has arrived

Targets = Callable[[Player, str], list[str]]  # the live parameters of a player that a path of the patch stands for


@dataclass
class Course:
    """The progress of a control from its old value to its new one. Shares: 0 at the low end of its range, 1 at the
    high."""

    control: Any
    paths: list[str]
    share: float
    target: float


class Controls:
    """The controls of a patch, and a player that they act on. Moves may come from any thread; one calls `poll`."""

    def __init__(self, scene: Scene, player: Player) -> None:
        self.refused: dict[str, str] = {}  # parameters that could not have a value, and why
        self.unknown: dict[str, int] = {}  # addresses that nothing belongs to, and how often they came
        self._lock = threading.Lock()
        self.use(scene, player)

    def use(self, scene: Scene, player: Player) -> None:
        """Act on another player, as that of an edited patch."""
        with self._lock:
            self.scene, self.player = scene, player
            self._polled = player.frame / player.samplerate - CONTROL_STEP_SECONDS
            self._courses: dict[tuple[int, tuple[str, ...]], Course] = {}
            self._direct: dict[str, float] = {}
            self._addresses = {"/" + path.replace(".", "/"): path for path in player.live_parameters}

    def takes(self, move: Move) -> bool:
        """True if a move of a MIDI controller changes a parameter."""
        return any(takes_move(control, move) for control in self.scene.control)

    def has_address(self, address: str) -> bool:
        """True if a control has this OSC address."""
        return any(control.kind == "osc" and control.address == address for control in self.scene.control)

    def move(self, move: Move, notes: Targets | None = None) -> None:
        """Remember a move of MIDI. notes: the targets of the notes that a pressure is of, if it is not of all"""
        for i, control in enumerate(self.scene.control):
            if takes_move(control, move):
                paths = (notes or targets_of_all)(self.player, control.parameter)
                if paths or notes is None:  # a key that sounds nothing changes nothing
                    self._aim(i, paths, move.value)

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
            self._aim(i, targets_of_all(self.player, control.parameter), share)
        if not controls and path is not None:
            with self._lock:
                self._direct[path] = value
        elif not controls:
            self.count_unknown(address)

    def count_unknown(self, address: str) -> None:
        """Count a message to an address that nothing belongs to."""
        shown = to_one_line(address, MAX_ADDRESS_CHARACTERS)
        with self._lock:
            if shown in self.unknown or len(self.unknown) < MAX_UNKNOWN:
                self.unknown[shown] = self.unknown.get(shown, 0) + 1

    def poll(self) -> None:
        """Make the steps that are due."""
        now = self.player.frame / self.player.samplerate
        passed = min(MAX_STEP_SECONDS, now - self._polled)
        if passed < CONTROL_STEP_SECONDS:
            return
        self._polled = now
        with self._lock:
            direct, self._direct = self._direct, {}
            moving = [course for course in self._courses.values() if course.share != course.target]
            for course in moving:
                course.share = approach(course.share, course.target, passed, course.control.smoothing)
        for course in moving:
            self._set(course.paths, value_of(course.control, course.share), passed)
        for path, value in direct.items():
            self._set([path], value, passed)
        self.refused = self.player.refused | self.refused

    def _aim(self, number: int, paths: list[str], target: float) -> None:
        if not paths:
            control = self.scene.control[number]
            self.refused.setdefault(control.parameter, "it cannot change while the patch plays")
            return
        with self._lock:
            key = number, tuple(paths)
            if key not in self._courses:
                control = self.scene.control[number]
                share = share_of(control, self.player.value(paths[0]))
                self._courses[key] = Course(control, paths, share, target)
            self._courses[key].target = target

    def _set(self, paths: Iterable[str], value: float, seconds: float) -> None:
        for path in paths:
            try:
                self.player.set(path, value, seconds)
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
    path = current_path(player.live_paths, f"{section}.{name}.{keys}")
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
