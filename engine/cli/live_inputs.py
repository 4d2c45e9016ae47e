"""What comes in while a patch is played: notes, moves of controllers, Open Sound Control."""

import argparse

from engine.live import midi
from engine.live.controls import Controls
from engine.live.osc import OscServer, parse_address


class Inputs:
    """Notes of a file or a port, moves of controllers, and OSC, as a session polls them."""

    def __init__(self, notes: midi.Source | None, osc: OscServer | None, controls: Controls) -> None:
        self._notes, self._osc, self._controls = notes, osc, controls

    @property
    def is_open(self) -> bool:
        """Whether anything may come."""
        return self._notes is not None or self._osc is not None

    def poll(self) -> bool:
        """Tell what has come; returns whether all notes are over."""
        over = self._notes is not None and self._notes()
        self._controls.poll()
        return over

    def close(self) -> list[str]:
        """End it all; returns what there is to be said."""
        if self._osc is None:
            return []
        self._osc.close()
        return self._osc.remarks()


def open_inputs(args: argparse.Namespace, allocator: midi.Allocator | None, controls: Controls) -> Inputs:
    """What the options ask for. Raises MidiError, OscError."""
    notes = midi.open_source(args.midi, allocator, controls) if args.midi else None
    osc = None if args.osc is None else OscServer(parse_address(args.osc), controls.receive)
    return Inputs(notes, osc, controls)
