"""The keys of a rig, played live: each message goes to the parts that it is for."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from engine.instrument.held_keys import ALL
from engine.instrument.tables import drum_keys
from engine.live.controls import Controls, Targets, targets_of_all
from engine.live.general_midi import DRUM_CHANNEL
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_notes import Move, Note
from engine.live.player import Player
from engine.patch.rig import Member, Rig

SETS_OF_PART = 1 << 20  # numbers of groups of events, more than a part has keys and positions of a pedal


@dataclass
class RigChoice:
    """The parts of a rig that programs have chosen, and those that hold what is pressed."""

    members: tuple[Member, ...]
    programs: dict[int, int] = field(default_factory=dict)  # by channel, from 1
    held: dict[tuple[int, int], list[list[Member]]] = field(default_factory=dict)  # of each press, by channel and key

    def __post_init__(self) -> None:
        self._drums = {member.name: drum_keys(member.document) or {} for member in self.members}

    def divide(self, note: Note) -> list[tuple[Member, Note]]:
        """Return what each part is to play of a message: notes are on its keys, at its velocities."""
        channel = note.channels.channel
        if note.kind == "program":
            self.programs[channel] = int(note.value) + 1
            return []
        if note.kind == "on":
            taking = [member for member in self.members if self._takes(member, note)]
            self.held.setdefault((channel, note.number), []).append(taking)
            return [(member, self._played(member, note)) for member in taking]
        if note.kind == "off":
            presses = self.held.get((channel, note.number), [])
            return [(member, self._played(member, note)) for member in (presses.pop(0) if presses else [])]
        concerned = [member for member in self.members if member.table.is_on(channel)]
        return [(member, self._moved(member, note) if note.kind == "tune" else note) for member in concerned]

    def _takes(self, member: Member, note: Note) -> bool:
        """True if a part plays a note: on its channel, of its keys and velocities, and the program chooses it."""
        channel = note.channels.channel
        return member.table.takes(channel, note.number, note.value) and self.is_chosen(member, channel)

    def is_chosen(self, member: Member, channel: int) -> bool:
        """True if the program of a channel chooses a part. Before the first program, the first part of those among
        which it chooses is on."""
        program = member.table.program
        if program is None:
            return True
        asked = self.programs.get(channel, self.programs.get(ALL))
        if asked is not None:
            return asked == program
        alike = [one for one in self.members if one.table.program is not None and one.table.is_on(channel)]
        return alike[0].table.program == program

    def _played(self, member: Member, note: Note) -> Note:
        """A note as a part plays it."""
        drums = self._drums[member.name]
        if note.channels.channel == DRUM_CHANNEL and note.number in drums:
            number = drums[note.number]
        else:
            number = note.number + member.table.transpose
        value = member.table.velocity(note.value) if note.kind == "on" else note.value
        return note._replace(number=number, value=value)

    def _moved(self, member: Member, note: Note) -> Note:
        return note._replace(number=note.number + member.table.transpose)


class RigKeys:
    """Plays the parts of a rig. player: of a live scene of the rig, with `waiting = True`"""

    def __init__(self, player: Player, rig: Rig) -> None:
        self.player, self.parts = player, dict[str, KeyAllocator]()
        for n, member in enumerate(rig.members):
            self.parts[member.name] = KeyAllocator(player, member, n * SETS_OF_PART)
        self._choice = RigChoice(rig.members)

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a message says, at a frame."""
        for member, one in self._choice.divide(note):
            self.parts[member.name].play(one, frame)

    def release_all(self, part: int, frame: int = 0) -> None:
        """Let go of all keys that a part of a file, or a channel, holds."""
        for keys in self.parts.values():
            keys.release_all(part, frame)

    def poll(self) -> None:
        """Bend the keys as far as wheels say by now."""
        for keys in self.parts.values():
            keys.poll()

    def take_over(self, other: object) -> None:
        """Go on from where the parts of the same names of another rig were."""
        if isinstance(other, RigKeys):
            self._choice.programs |= other._choice.programs
            for name, keys in self.parts.items():
                keys.take_over(other.parts.get(name))

    @property
    def together(self) -> bool:
        """True if wheels and pedals act on the notes of all channels."""
        return all(keys.together for keys in self.parts.values())

    @together.setter
    def together(self, together: bool) -> None:
        for keys in self.parts.values():
            keys.together = together

    @property
    def controls(self) -> Controls | None:
        """That notes begin with what their channels have moved."""
        return next(iter(self.parts.values())).controls

    @controls.setter
    def controls(self, controls: Controls | None) -> None:
        for keys in self.parts.values():
            keys.controls = controls

    @property
    def keys(self) -> list[int]:
        """The keys that any part has."""
        return sorted({key for keys in self.parts.values() for key in keys.keys})

    @property
    def stolen(self) -> int:
        """Notes that ended for want of others."""
        return sum(keys.stolen for keys in self.parts.values())

    @property
    def refused(self) -> int:
        """Notes that no key was there for."""
        return sum(keys.refused for keys in self.parts.values())

    @property
    def ignored(self) -> dict[str, int]:
        """Messages that did nothing, by what they are."""
        return merge_counts(keys.ignored for keys in self.parts.values())

    def played_notes(self) -> dict[str, str]:
        """Count the notes of each key of each part that was played."""
        played = ((name, keys.played_notes()) for name, keys in self.parts.items())
        return {f"{name} {key}": text for name, notes in played for key, text in notes.items()}

    def targets(self, move: Move, is_of_one_note: bool) -> Targets | None:
        """Return the live parameters that a move of a controller changes if it concerns some notes alone."""
        found = [(keys.prefix, keys.targets(move, is_of_one_note)) for keys in self.parts.values()]
        if all(targets is None for _, targets in found):
            return None

        def of_part(player: Player, path: str) -> list[str]:
            for prefix, targets in found:
                if ".".join(path.split(".")[1:2]).startswith(prefix) and targets is not None:
                    return targets(player, path)
            return targets_of_all(player, path)

        return of_part


def merge_counts(counts: Iterable[dict[str, int]]) -> dict[str, int]:
    """Return the sums of counts by their names."""
    merged = dict[str, int]()
    for one in counts:
        for name, count in one.items():
            merged[name] = merged.get(name, 0) + count
    return merged
