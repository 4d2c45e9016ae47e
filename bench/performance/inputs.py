"""The delay of a note behind one second of a controller that sends 300 messages, and the price of a pedal.

`uv run python -m bench inputs [PATCH …]`: messages come at a MIDI port as a session polls it, in real time;
instruments are played by their keys, other patches by voices.
"""

import sys
import time
import types
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import mido
import numpy as np

import engine
from engine.cli.live_inputs import Inputs
from engine.instrument.expansion import keys_of
from engine.live.controls import Controls
from engine.live.key_allocator import live_scene
from engine.live.midi import PORT_LOWEST, make_allocator
from engine.live.midi_port import MidiPort
from engine.live.osc_commands import OscCommands
from engine.live.player import Player

RATE, BLOCK, POLL_SECONDS = 48_000, 256, 0.004
PER_SECOND, SECONDS, HELD, NOTES, VOICES = 300, 1.0, 4, 3, 8
INSTRUMENTS = ("guitar", "kalimba_keys", "marimba_keys", "piano", "sitar", "snare", "toms", "vibraphone", "violin")
BY_VOICES = ("marimba", "tanpura", "piano_c4", "bass_frets")
MOVES = {
    "wheel": lambda n: mido.Message("pitchwheel", pitch=int(4000 * np.sin(n / 20))),
    "pedal": lambda n: mido.Message("control_change", control=64, value=int(63.5 + 63.5 * np.sin(n / 20))),
    "controller": lambda n: mido.Message("control_change", control=1, value=n % 128),
}


class Delay(NamedTuple):
    """Times of a note and of messages, ms."""

    note: float  # from the message to when its events are told, behind a second of the controller: the least of NOTES
    poll: float  # the longest look at the port


@contextmanager
def echo_port() -> Iterator[list[Any]]:
    """A MIDI port that is none: what is sent to it comes out of it."""
    opened: list[Any] = []

    class Port(mido.ports.EchoPort):  # type: ignore[misc]
        def __init__(self, name: str | None = None, **told: Any) -> None:
            super().__init__(name)
            opened.append(self)

    driver = types.ModuleType("echo_driver")
    driver.Input = Port  # type: ignore[attr-defined]
    driver.get_devices = lambda **told: [{"name": "echo", "is_input": True, "is_output": False}]  # type: ignore[attr-defined]
    sys.modules["echo_driver"], before = driver, mido.backend
    mido.set_backend("echo_driver")
    yield opened
    mido.set_backend(before)


def measure(name: str, move: str) -> Delay:
    """Measure the delay of a note of a patch behind a controller."""
    scene = engine.load(name)
    if scene.instrument is not None:
        player, keys = Player(live_scene(scene), RATE, float("inf"), 1e-3, waiting=True, kernel="general"), []
        keys = keys_of(scene.instrument["keyboard"])
        keys = (keys[len(keys) // 3 :] + keys * NOTES)[: HELD + NOTES]  # a drum has few
    else:
        player = Player(scene, RATE, float("inf"), 1e-3, voices=VOICES, lowest=PORT_LOWEST, kernel="general")
        keys = [60 + n for n in range(HELD + NOTES)]
    controls = Controls(player.scene, player)
    commands, out = OscCommands(controls, make_allocator(player)), np.zeros((BLOCK, player.channels), np.float32)
    with echo_port() as opened:
        inputs = Inputs(MidiPort("echo", lambda: commands.keys, controls), None, commands, controls)
        (port,) = opened
        for key in keys[:HELD]:
            port.send(mido.Message("note_on", note=key, velocity=80))
        inputs.poll()
        assert commands.keys is not None
        longest, shortest, sent = 0.0, float("inf"), 0
        for key in keys[HELD:]:
            begin, first = time.perf_counter(), sent
            while (now := time.perf_counter() - begin) < SECONDS:
                while sent < first + now * PER_SECOND:
                    port.send(MOVES[move](sent))
                    sent += 1
                before = time.perf_counter()
                inputs.poll()
                longest = max(longest, time.perf_counter() - before)
                player.render_into(out)
                time.sleep(POLL_SECONDS)
            told, before = commands.keys.played_notes(), time.perf_counter()
            port.send(mido.Message("note_on", note=key, velocity=100))
            while commands.keys.played_notes() == told:
                time.sleep(POLL_SECONDS)  # as a session does
                inputs.poll()
            shortest = min(shortest, time.perf_counter() - before)
        inputs.close()
    return Delay(1000 * shortest, 1000 * longest)


def main(arguments: list[str]) -> int:
    """Measure instruments and patches by voices, or those that are named, and print a table."""
    print("| patch | controller | note told after, ms | longest look at the port, ms |\n| --- | --- | --- | --- |")
    for name in arguments or [*INSTRUMENTS, *BY_VOICES]:
        for move in MOVES:
            delay = measure(name, move)
            print(f"| {name} | {move} | {delay.note:.1f} | {delay.poll:.1f} |", flush=True)
    return 0
