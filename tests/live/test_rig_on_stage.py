"""A rig under JACK's dummy driver: each part is heard, programs change, and keys are tuned while it plays."""

import json
import math

import numpy as np
import pytest
import soundfile
from conftest import needs_portaudio
from test_drivers import jack, needs_jack  # noqa: F401

import engine
from engine.instrument.key_names import note_frequency
from engine.live.instrument_notes import scene_of_file
from tests.live.stage import play_on_stage
from tests.live.test_rigs import saved_rig

RATE = 44_100
STAGE = """
import sys, time
from socket_midi import Source
source = Source("stage")
sys.stdin.readline()
time.sleep(0.5)
on = lambda key, channel: [0x90 | channel - 1, key, 90]
off = lambda key, channel: [0x80 | channel - 1, key, 64]
octave = [0xF0, 0x7F, 0x7F, 8, 9, 3, 127, 127] + [b for n in range(12) for b in (96 if n == 4 else 64, 0)] + [0xF7]
for message in (
    on(60, 1), off(60, 1),                      # the first part
    [0xC0, 1], on(62, 1), off(62, 1),           # its program is the second part's
    on(72, 2), off(72, 2),                      # the third, an octave higher
    octave, on(64, 1), off(64, 1),              # E is half a semitone higher
    [0xC0, 0], on(65, 1), off(65, 1),           # the first again
):
    source.send(message)
    time.sleep(0.35 if message[0] >> 4 == 9 else 0.15)
print("done", flush=True)
sys.stdin.readline()
"""
PARTS = (
    'name = "first"\npatch = "bars.json"\nchannel = 1\nprogram = 1',
    'name = "second"\npatch = "bars.json"\nchannel = 1\nprogram = 2',
    'name = "third"\npatch = "high.json"\nchannel = 2\ntranspose = 12',
)


def measured(audio: np.ndarray) -> float:
    """The frequency of the strongest tone, Hz."""
    size = 1 << 19
    return float(np.argmax(np.abs(np.fft.rfft(audio * np.hanning(len(audio)), size)))) * RATE / size


@pytest.mark.hard
@needs_portaudio
@needs_jack
def test_parts_programs_and_tunings_are_heard_on_stage(tmp_path, jack):  # noqa: F811
    rig, take, log = saved_rig(tmp_path, *PARTS), tmp_path / "take.wav", tmp_path / "log.json"
    notes = tmp_path / "take.mid"
    words = [str(rig), "--midi", "stage", "--record", str(take), "--record", str(notes), "--event-log", str(log)]
    words += ["--ignore-speed"]
    play_on_stage(tmp_path, jack[0], "stage", STAGE, words)
    events = [e for e in json.loads(log.read_text())["events"] if e["why"][0] == "pluck"]
    played = [event["why"][1] for event in events]
    assert played == ["first__C4_bar", "second__D4_bar", "third__C6_bar", "second__E4_bar", "first__F4_bar"]
    recorded = scene_of_file(engine.load(rig), notes).scene
    plucks = sorted((event for event in recorded.event if event.kind == "pluck"), key=lambda event: event.time)
    assert [event.body for event in plucks] == played  # the notes that were recorded, with their programs
    frames = [max(event["frame"], int(event["row"][4])) for event in events]
    apart = [one.time - plucks[0].time - (frame - frames[0]) / RATE for one, frame in zip(plucks, frames, strict=True)]
    assert max(map(abs, apart)) < 0.01
    audio = soundfile.read(take)[0][:, 0]
    wanted = [note_frequency(60), note_frequency(62), note_frequency(84), note_frequency(64.5), note_frequency(65)]
    for event, frequency in zip(events, wanted, strict=True):
        begin = max(event["frame"], int(event["row"][4]))
        heard = measured(audio[begin + 2000 : begin + 13_000])
        assert abs(1200 * math.log2(heard / frequency)) < 5.0, event["why"]
