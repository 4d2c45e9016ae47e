"""Input while a patch is played: notes, moves of controllers, Open Sound Control."""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from engine.cli.option_checks import excerpt_of
from engine.live import midi
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator
from engine.live.osc import OscServer, parse_address
from engine.live.osc_commands import OscCommands
from engine.live.player import Player
from engine.patch.scene import Scene


class Inputs:
    """Notes of a file or a port, moves of controllers, and OSC, as a session polls them.

    moves: called again and again beside the notes, which do not wait for the tables that they build
    """

    def __init__(
        self,
        notes: midi.Source | None,
        osc: OscServer | None,
        commands: OscCommands,
        moves: Sequence[Callable[[], None]],
    ) -> None:
        self._notes, self._osc, self._commands, self._moves = notes, osc, commands, moves
        self._worker, self._made = ThreadPoolExecutor(1), Future[None]()
        self._made.set_result(None)

    @property
    def is_open(self) -> bool:
        """True if any input is open."""
        return self._notes is not None or self._osc is not None

    def use(self, scene: Scene, player: Player) -> None:
        """Act on another player, as that of an edited patch."""
        self._commands.use(scene, player)

    def take_notices(self) -> list[str]:
        """Return the lines to be shown that came since the last call."""
        return self._commands.notices.take()

    @property
    def osc_port(self) -> int | None:
        """The UDP port that receives OSC."""
        return None if self._osc is None else self._osc.port

    def poll(self) -> bool:
        """Tell what has come; returns whether all notes are over."""
        over = self._notes is not None and self._notes()
        self._commands.poll()
        if self._made.done():
            self._made.result()  # raises what it raised
            self._made = self._worker.submit(self._make_moves)
        return over

    def _make_moves(self) -> None:
        for move in self._moves:
            move()

    def close(self) -> list[str]:
        """End it all; returns what there is to be said."""
        self._worker.shutdown(cancel_futures=True)
        if self._osc is None:
            return []
        self._osc.close()
        return [*self._osc.remarks(), *self._commands.remarks()]


def open_inputs(args: argparse.Namespace, allocator: midi.Allocator | None, controls: Controls) -> Inputs:
    """Open the inputs that the options name. Raises MidiError, OscError."""
    notes = midi.open_source(args.midi, allocator, controls, excerpt_of(args)) if args.midi else None
    commands = OscCommands(controls, allocator)
    osc = None if args.osc is None else OscServer(parse_address(args.osc), commands.receive, commands.notices.add)
    bends = [allocator.poll] if isinstance(allocator, KeyAllocator) else []
    return Inputs(notes, osc, commands, [controls.poll, *bends])
