"""Input while a patch is played: notes, moves of controllers, Open Sound Control."""

import argparse
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from engine.cli.notes import levels_of_file
from engine.cli.option_checks import excerpt_of
from engine.instrument.tables import drum_keys
from engine.live import midi
from engine.live.controls import Controls
from engine.live.level_player import LevelPlayer
from engine.live.midi_clock import open_clocked_file
from engine.live.midi_files import is_midi_file, read_notes
from engine.live.midi_port import MidiPort
from engine.live.midi_recording import MidiRecording
from engine.live.osc import OscServer, parse_address
from engine.live.osc_commands import OscCommands
from engine.live.player import Player
from engine.patch.scene import Scene


class Inputs:
    """Notes of a file or a port, moves of controllers, and OSC, as a session polls them.

    Controls and pitch wheels are followed beside the notes, which do not wait for the tables that they take.
    """

    def __init__(
        self,
        notes: midi.MidiFilePlayer | MidiPort | None,
        osc: OscServer | None,
        commands: OscCommands,
        controls: Controls,
        levels: LevelPlayer | None = None,
        record: MidiRecording | None = None,
    ) -> None:
        self._notes, self._osc, self._commands, self._controls = notes, osc, commands, controls
        self._levels, self._record = levels, record
        self._worker, self._made = ThreadPoolExecutor(1), Future[None]()
        self._made.set_result(None)

    @property
    def is_open(self) -> bool:
        """True if any input is open."""
        return self._notes is not None or self._osc is not None or self._levels is not None

    def prepare(self, player: Player) -> Player:
        """Make beside the sound what gives notes to another player; returns the player."""
        self._commands.prepare(player)
        return player

    def use(self, scene: Scene, player: Player) -> None:
        """Act on another player, as that of an edited patch."""
        self._commands.use(scene, player)
        if isinstance(self._notes, midi.MidiFilePlayer) and self._commands.keys is not None:
            self._notes.use(self._commands.keys)
        if self._levels is not None:
            self._levels.use(player)

    @property
    def allocator(self) -> midi.Allocator | None:
        """The allocator that plays the notes now."""
        return self._commands.keys

    def take_notices(self) -> list[str]:
        """Return the lines to be shown that came since the last call."""
        return self._commands.notices.take()

    @property
    def osc_port(self) -> int | None:
        """The UDP port that receives OSC."""
        return None if self._osc is None else self._osc.port

    def poll(self) -> bool:
        """Tell what has come; returns whether all notes are over."""
        over = self._notes is not None and self._notes.poll()
        if self._levels is not None:
            self._levels.poll()
        self._commands.poll()
        if self._made.done():
            self._made.result()  # raises what it raised
            self._made = self._worker.submit(self._make_moves)
        return over

    def _make_moves(self) -> None:
        self._controls.poll()
        if self._commands.keys is not None:
            self._commands.keys.poll()

    def close(self) -> list[str]:
        """End it all, and write what was played; returns what there is to be said. Raises OSError."""
        self._worker.shutdown(cancel_futures=True)
        if self._record is not None:
            self._record.save()
        if self._osc is None:
            return []
        self._osc.close()
        return [*self._osc.remarks(), *self._commands.remarks()]


def open_inputs(
    args: argparse.Namespace, allocator: midi.Allocator | None, controls: Controls, channels: int
) -> Inputs:
    """Open the inputs that the options name. channels: of the patch, before it was brought to those of the device.
    Raises MidiError, OscError."""
    commands, levels = OscCommands(controls, allocator), None
    notes: midi.MidiFilePlayer | MidiPort | None = None
    record = None if args.record_midi is None else MidiRecording(args.record_midi)
    if args.clock is not None:
        notes = open_clocked_file(args.midi, args.clock, allocator, controls, excerpt_of(args))
    elif args.midi and is_midi_file(args.midi):
        notes = midi.open_file(args.midi, allocator, controls, excerpt_of(args))
        levels = open_levels(args, controls, notes, channels)
    elif args.midi:
        notes = MidiPort(args.midi, lambda: commands.keys, controls, commands.notices.add, record)
    osc = None if args.osc is None else OscServer(parse_address(args.osc), commands.receive, commands.notices.add)
    return Inputs(notes, osc, commands, controls, levels, record)


def open_levels(
    args: argparse.Namespace, controls: Controls, notes: midi.MidiFilePlayer | None, channels: int
) -> LevelPlayer:
    """Open the volumes and pans of a file, for its notes or for the score that was made of it."""
    if notes is not None:
        return LevelPlayer(levels_of_file(notes.file), controls.player, midi.LEAD_IN, channels)
    drums = drum_keys(controls.scene.instrument)
    file = read_notes(Path(args.midi), controls.scene.midi, excerpt=excerpt_of(args), drums=drums)
    return LevelPlayer(levels_of_file(file), controls.player, 0.0, channels)
