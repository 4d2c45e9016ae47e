"""What comes in while a patch is played: notes, moves of controllers, Open Sound Control."""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from engine.live import midi
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_parts import Excerpt
from engine.live.osc import OscServer, parse_address


class Inputs:
    """Notes of a file or a port, moves of controllers, and OSC, as a session polls them.

    moves: called again and again beside the notes, which do not wait for the tables that they build
    """

    def __init__(self, notes: midi.Source | None, osc: OscServer | None, moves: Sequence[Callable[[], None]]) -> None:
        self._notes, self._osc, self._moves = notes, osc, moves
        self._worker, self._made = ThreadPoolExecutor(1), Future[None]()
        self._made.set_result(None)

    @property
    def is_open(self) -> bool:
        """Whether anything may come."""
        return self._notes is not None or self._osc is not None

    def poll(self) -> bool:
        """Tell what has come; returns whether all notes are over."""
        over = self._notes is not None and self._notes()
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
        return self._osc.remarks()


def open_inputs(
    args: argparse.Namespace, allocator: midi.Allocator | None, controls: Controls, excerpt: Excerpt
) -> Inputs:
    """What the options ask for. excerpt: of a MIDI file. Raises MidiError, OscError."""
    notes = midi.open_source(args.midi, allocator, controls, excerpt) if args.midi else None
    osc = None if args.osc is None else OscServer(parse_address(args.osc), controls.receive)
    bends = [allocator.poll] if isinstance(allocator, KeyAllocator) else []
    return Inputs(notes, osc, [controls.poll, *bends])
