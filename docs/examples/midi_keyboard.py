"""Play an instrument from a MIDI port, from Python.

    uv run --extra midi python docs/examples/midi_keyboard.py [PATCH [PORT]]

PATCH is an instrument, that is, a patch with a [keyboard] (kalimba_keys if it is absent), and PORT the name of a port
(the first one if it is absent). Pedals work, too. Ctrl-C ends it. `fdh play kalimba_keys --midi PORT` does the same,
and follows pitch bend.
"""

import contextlib
import math
import sys

import mido

import fdh
from fdh.live.key_allocator import KeyAllocator, live_scene
from fdh.live.midi_notes import parse_message
from fdh.live.mpe import MpeZones

instrument = fdh.load(sys.argv[1] if len(sys.argv) > 1 else "kalimba_keys")
loudest = fdh.render(instrument, seconds=1.0).stats.peak  # of its own notes, in SI units
scene = live_scene(instrument)  # all keys at rest
player = fdh.Player(scene, seconds=math.inf, gain=0.3 / loudest, waiting=True)
keys, zones = KeyAllocator(player), MpeZones(scene.midi)
port = mido.open_input(sys.argv[2] if len(sys.argv) > 2 else None)
with player, port, contextlib.suppress(KeyboardInterrupt):
    print("play:", port.name)
    for message in port:
        if note := parse_message(message, 0.0, zones):
            keys.play(note)
print("played:", keys.played_notes())
