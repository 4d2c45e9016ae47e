"""Plays notes through a plug-in of VST3: vst3_host.py HOST BUNDLE RATE BLOCK FRAMES < messages (JSON: frame and bytes).
Writes float32, channels interleaved, and what the host says of the plug-in on standard error.

A program of its own: hosts keep plug-ins, and print what these say, as they end.
"""

import json
import struct
import sys
import tempfile
from pathlib import Path

import numpy as np


def play_in_pedalboard(bundle, rate, block, frames, messages):
    import pedalboard

    plugin = pedalboard.load_plugin(bundle)
    parameters = {n: float(p.raw_value) for n, p in plugin.parameters.items() if not n.startswith("midi_ch")}
    said = {"name": plugin.name, "maker": plugin.manufacturer_name, "parameters": parameters}
    given = [(bytes(data), frame / rate) for frame, data in messages]
    return plugin(given, duration=frames / rate, sample_rate=rate, num_channels=2, buffer_size=block).T, said


def play_in_dawdreamer(bundle, rate, block, frames, messages):
    import dawdreamer

    engine = dawdreamer.RenderEngine(rate, block)
    plugin = engine.make_plugin_processor("patch", bundle)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "notes.mid"
        path.write_bytes(midi_file(rate, messages))
        plugin.load_midi(str(path), clear_previous=True, beats=False, all_events=True)
    engine.load_graph([(plugin, [])])
    engine.render(frames / rate)
    return engine.get_audio().T, {"name": plugin.get_name()}


def midi_file(rate, messages):
    """Return a MIDI file in which a tick is a sample."""
    track, last = b"\0\xff\x51\x03" + (500_000).to_bytes(3, "big"), 0
    for frame, data in messages:
        track += number(frame - last) + bytes(data)
        last = frame
    track += b"\0\xff\x2f\0"
    return b"MThd" + struct.pack(">IHHH", 6, 0, 1, rate // 2) + b"MTrk" + struct.pack(">I", len(track)) + track


def number(value):
    """Return a number as MIDI files have it, seven bits a byte."""
    parts = [value & 127]
    while value := value >> 7:
        parts.insert(0, value & 127 | 128)
    return bytes(parts)


HOSTS = {"pedalboard": play_in_pedalboard, "dawdreamer": play_in_dawdreamer}


def main():
    host, bundle, *numbers = sys.argv[1:]
    audio, said = HOSTS[host](bundle, *map(int, numbers), json.load(sys.stdin))
    print(json.dumps(said), file=sys.stderr)
    sys.stdout.buffer.write(np.ascontiguousarray(audio, np.float32).tobytes())


if __name__ == "__main__":
    main()
