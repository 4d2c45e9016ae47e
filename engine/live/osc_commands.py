"""Messages of Open Sound Control that play a patch, beside those that change its parameters."""

import difflib
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from engine.bodies import Mass, Oscillator
from engine.instrument.key_names import HIGHEST_KEY, LOWEST_KEY, describe_keys, note_name, parse_key
from engine.live.controls import Controls
from engine.live.frame_clock import FrameClock
from engine.live.key_allocator import KeyAllocator
from engine.live.midi import Allocator, make_allocator
from engine.live.midi_notes import UNKNOWN_RELEASE, Note
from engine.live.notices import Notices
from engine.live.osc import TimedMessage, finite_number, number_in
from engine.live.player import Player
from engine.patch.scene import Scene
from engine.wording import format_names, format_value, to_one_line

USAGES = {
    "/strike": "/strike [NAME] [VELOCITY]",
    "/pluck": "/pluck [NAME] [SCALE]",
    "/damp": "/damp [NAME]",
    "/note": "/note KEY VELOCITY",
    "/mute": "/mute",
}
MAX_NOTE_VELOCITY = 127.0
MAX_WAITING = 1024  # messages; there is no room for more …
MAX_RELEASES = 16_384  # … but for keys that are let go
MAX_AHEAD = 60.0  # s, by which the time of a message may lie ahead
MAX_AT_ONCE = 32  # messages, between two looks at the other inputs
MAX_SHOWN = 60  # characters of what a message says
NO_NOTES = "the notes of a file are played; give --midi a port, or leave it out"
NO_VOICES = "notes need voices that can be tuned; give --voices 8"


class OscCommands:
    """Plays what messages say. They arrive from any thread, and wait until `poll` is called beside the other notes.

    controls: that all other messages change
    keys:     what plays notes; None if nothing does
    """

    def __init__(self, controls: Controls, keys: Allocator | None) -> None:
        self.keys, self.notices, self.refused = keys, Notices(), 0
        self._controls, self._clock = controls, FrameClock()
        self._prepared: tuple[Player, Allocator | None] | None = None
        self._waiting: deque[TimedMessage] = deque()
        self._later: list[TimedMessage] = []  # that move controls
        self._commands: dict[str, Callable[[list[Any], int], None]] = {
            "/strike": self._strike,
            "/pluck": self._pluck,
            "/damp": self._damp,
            "/note": self._note,
            "/mute": self._mute,
        }

    @property
    def player(self) -> Player:
        """The player that sounds."""
        return self._controls.player

    def prepare(self, player: Player) -> None:
        """Make what gives notes to another player, beside the sound: that takes a while."""
        self._prepared = player, make_allocator(player)

    def use(self, scene: Scene, player: Player) -> None:
        """Act on another player, as that of an edited patch."""
        self._controls.use(scene, player)
        if self._prepared is None or self._prepared[0] is not player:
            self.prepare(player)
        assert self._prepared is not None
        before, self.keys, self._prepared = self.keys, self._prepared[1], None
        if self.keys is not None and before is not None:
            self.keys.take_over(before)

    def receive(self, message: TimedMessage) -> bool:
        """Keep a message until it is played, or move what it controls. Returns whether it is well formed."""
        address, arguments, _ = message
        if self._is_command(address):
            self._keep(message)
            return True
        if not self._controls.knows(address):
            self._controls.count_unknown(address)
            shown = to_one_line(address, MAX_SHOWN)
            self.notices.add(f"OSC: no control or live parameter is called {shown}; {', '.join(USAGES)} play")
            return True
        value = number_in(arguments)
        if value is not None and message.time is None:
            self._controls.receive(address, value)
        elif value is not None:
            self._keep(message)
        return value is not None

    def _keep(self, message: TimedMessage) -> None:
        """Let a message wait until it is played, if there is room."""
        if len(self._waiting) < (MAX_RELEASES if lets_go(message) else MAX_WAITING):
            self._waiting.append(message)
        else:
            self.refused += 1

    def poll(self) -> None:
        """Play what has arrived."""
        now = time.time()
        for message in [one for one in self._later if one.time is not None and one.time <= now]:
            self._later.remove(message)
            self._controls.receive(message.address, float(message.arguments[0]))
        for _ in range(min(len(self._waiting), MAX_AT_ONCE)):
            address, arguments, seconds = self._waiting.popleft()
            try:
                if seconds is not None and seconds > now + MAX_AHEAD:
                    raise ValueError(f"its time is {seconds - now:.0f} s ahead; give at most {MAX_AHEAD:.0f} s")
                frame = 0 if seconds is None else self._clock.frame_at(self.player, seconds)
                if self._is_command(address):
                    self._commands[address](arguments, frame)
                elif not self._controls.set_at(address, float(arguments[0]), frame):
                    self._later.append(TimedMessage(address, arguments, seconds))
            except (LookupError, TypeError, ValueError) as error:
                self.refused += 1
                reason = str(error.args[0]) if error.args else type(error).__name__
                self.notices.add(f"OSC {address}: {reason}")

    def remarks(self) -> list[str]:
        """Return what there is to be said at the end."""
        return [f"OSC: {self.refused} messages could not be played"] if self.refused else []

    def _is_command(self, address: str) -> bool:
        """True if an address is that of a command; a control of the patch comes before it."""
        return address in self._commands and not self._controls.has_address(address)

    # --- commands

    def _strike(self, arguments: list[Any], frame: int) -> None:
        name, velocity = _name_and_number(arguments, "/strike")
        if name is None:
            if not (self.player.strikers or self.player.plucked):
                raise ValueError("the patch has no strike and no pluck; name a hammer, and its velocity")
            self.player.strike(velocity=velocity, frame=frame)
            return
        masses = [body.name for body in self.player.scene.body if isinstance(body, Mass | Oscillator)]
        for hammer in self._copies(name, masses, "hammer"):
            if velocity is None and not self.player.default_velocity(hammer):
                raise ValueError(f"the patch gives {hammer} no velocity; give one, such as /strike {name} 2.0")
            self.player.strike(hammer, velocity, frame=frame)

    def _pluck(self, arguments: list[Any], frame: int) -> None:
        name, scale = _name_and_number(arguments, "/pluck")
        plucked = self.player.plucked
        if not plucked:
            raise ValueError("the patch has no pluck; it needs a [[force]] of kind pluck")
        for body in plucked if name is None else self._copies(name, plucked, "plucked body"):
            self.player.pluck(body, 1.0 if scale is None else scale, frame)

    def _damp(self, arguments: list[Any], frame: int) -> None:
        name, number = _name_and_number(arguments, "/damp")
        if number is not None:
            raise ValueError(_wrong_arguments(arguments, "/damp"))
        bodies = [body.name for body in self.player.scene.body]
        for body in [None] if name is None else self._copies(name, bodies, "body"):
            self.player.damp(body, frame=frame)

    def _mute(self, arguments: list[Any], frame: int) -> None:
        if arguments and finite_number(arguments[0]) is None:
            raise ValueError(_wrong_arguments(arguments, "/mute"))
        if arguments[:1] != [0]:  # which buttons send when they are let go
            self.player.damp(frame=frame)

    def _note(self, arguments: list[Any], frame: int) -> None:
        if len(arguments) != 2:
            raise ValueError(_wrong_arguments(arguments, "/note"))
        key, velocity = _key_number(arguments[0]), finite_number(arguments[1])
        if velocity is None or not 0.0 <= velocity <= MAX_NOTE_VELOCITY:
            raise ValueError(
                f"velocity {format_value(arguments[1])} is out of range; give 0, which releases the key, to 127"
            )
        if self.keys is None:
            raise ValueError(NO_NOTES if self.player.patch.instrument is not None else NO_VOICES)
        refused = self.keys.refused
        self.keys.play(Note(0.0, "on", key, velocity) if velocity else Note(0.0, "off", key, UNKNOWN_RELEASE), frame)
        if self.keys.refused > refused:
            remedy = describe_keys(self.keys.keys) if isinstance(self.keys, KeyAllocator) else "another octave"
            raise ValueError(f"{note_name(key)} is beyond the keys or pitches of the patch; {remedy}")

    def _copies(self, name: str, known: Iterable[str], what: str) -> list[str]:
        """The bodies of a name: in voices, the copies of the one that the patch calls so. Raises ValueError if none of
        the known ones is called so."""
        copies: dict[str, list[str]] = {}
        for body in known:
            copies.setdefault(body.rpartition("_")[0] if self.player.voices else body, []).append(body)
        if name not in copies:
            near = difflib.get_close_matches(name[:MAX_SHOWN], copies, len(copies) or 1, 0.0)
            raise ValueError(f"no {what} is called {format_value(name)}; there are {format_names(near)}")
        return copies[name]


def lets_go(message: TimedMessage) -> bool:
    """True if a message lets a key go, or ends what sounds."""
    return message.address in ("/mute", "/damp") or (message.address == "/note" and message.arguments[1:] == [0])


def _name_and_number(arguments: list[Any], address: str) -> tuple[str | None, float | None]:
    """The name and the number of a message, each of which may be absent. Raises ValueError if it has anything else."""
    name = next((argument for argument in arguments[:1] if isinstance(argument, str)), None)
    numbers = [finite_number(argument) for argument in arguments[0 if name is None else 1 :]]
    if len(numbers) > 1 or None in numbers:
        raise ValueError(_wrong_arguments(arguments, address))
    return name, numbers[0] if numbers else None


def _wrong_arguments(arguments: list[Any], address: str) -> str:
    """Describe the error in the arguments of a message."""
    shown = to_one_line(" ".join(format_value(argument) for argument in arguments[:4]), MAX_SHOWN)
    return f"cannot take {shown or 'no arguments'}; {USAGES[address]}"


def _key_number(argument: Any) -> int:
    """The number of a key by its MIDI number or its name. Raises ValueError."""
    if isinstance(argument, str):
        with suppress(ValueError):
            return parse_key(argument)
    number = float(argument) if isinstance(argument, str) and argument.isdecimal() else finite_number(argument)
    if number is None or number not in range(LOWEST_KEY, HIGHEST_KEY + 1):
        raise ValueError(f'{format_value(argument)} is not a key; give 0 to 127, or a name such as "C4"')
    return int(number)
