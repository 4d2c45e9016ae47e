"""A rehearsal of an instrument under JACK's dummy driver, in real time: notes, pedal, wheel, sliders, edits, a source
that goes and comes back.

FDH_REHEARSAL_SECONDS=1200 FDH_REHEARSAL_QUIET=1 uv run pytest -n 0 -m hard tests/live/test_rehearsal.py: for twenty
minutes, as root, on a machine that does nothing else, so that the times of notes and dropouts count, too. A program
beside it, which does nothing but wake up for each block, says how often the machine itself is late.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, needs_portaudio
from test_drivers import jack, needs_jack, run, start  # noqa: F401

import engine
from engine.instrument.expansion import keys_of
from engine.live.replay import read_log

SECONDS = float(os.environ.get("FDH_REHEARSAL_SECONDS", "45"))
IS_QUIET = os.environ.get("FDH_REHEARSAL_QUIET") == "1"
SCORE = Path(engine.__file__).parents[1] / "docs" / "examples" / "canon.mid"
MOST_LATE, NEAR = 0.020, 10.0  # s, behind the note that was played soonest of those near it: a dropout stops the clock
BLOCK, SPARE = 256 / 44_100, 0.7  # s; share of a block that a late thread may lose, as the engine takes the rest


def struck_notes(log) -> list[float]:
    """Return when the strikes of a session began, s from its beginning."""
    notes, begin = [], 0
    while log is not None:
        for event in log.events:
            if event.frame is not None and event.why[:1] == ["strike"]:
                notes.append((begin + max(event.frame, int(event.row[4]))) / log.samplerate)
        begin += log.end - log.leave
        log = log.next
    return notes


@pytest.mark.hard
@needs_portaudio
@needs_jack
def test_a_rehearsal_loses_no_note_and_replays_to_the_same_bits(tmp_path, jack):  # noqa: F811
    environment, _ = jack
    environment = environment | {"MIDO_BACKEND": "socket_midi", "FDH_TEST_MIDI": str(tmp_path)}
    environment = environment | {"PYTHONPATH": str(Path(__file__).parent)}
    name = os.environ.get("FDH_REHEARSAL_PATCH", "marimba_keys")
    patch, take, log = tmp_path / f"{name}.toml", tmp_path / "take.wav", tmp_path / "log.json"
    patch.write_text((ROOT / "patches" / f"{name}.toml").read_text("utf-8"), "utf-8")
    port = 9000 + os.getpid() % 2000
    script = [sys.executable, str(Path(__file__).with_name("rehearsal.py")), str(SCORE), str(patch), str(port)]
    stalls = [sys.executable, str(Path(__file__).with_name("stalls.py")), str(BLOCK), str(SPARE * BLOCK)]
    watch = subprocess.Popen(stalls, stdout=subprocess.PIPE, text=True) if IS_QUIET else None
    source = subprocess.Popen(
        [*script, str(SECONDS)],
        env={**os.environ, **environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    words = [str(patch), "--midi", "rehearsal", "--osc", str(port), "--record", str(take), "--event-log", str(log)]
    while not (tmp_path / "rehearsal.port").exists():
        assert source.poll() is None
        time.sleep(0.05)
    program = start(environment, "play", *words, "--watch", "--device", "JACK Audio", "--ignore-speed")
    try:
        sent = json.loads(source.communicate("go\n", timeout=SECONDS + 120.0)[0])
        program.send_signal(signal.SIGINT)
        said, errors = program.communicate(timeout=60.0)
    finally:
        source.kill()
        program.kill()
    (tmp_path / "sent.json").write_text(json.dumps(sent), "utf-8")
    assert program.returncode == 130, errors
    assert "is gone" in said + errors and "is back" in said + errors
    assert (said + errors).count("switched to the new version") == sent["edits"] > 0
    session = read_log(log)
    played = struck_notes(session)
    keys = keys_of(engine.load(name).instrument["keyboard"])
    told = [time for time, key in sent["notes"] if key in keys]
    assert len(played) == len(told)
    ahead = [begun - time for begun, time in zip(played, told, strict=True)]
    early = [min(a for a, t in zip(ahead, told, strict=True) if abs(t - time) < NEAR) for time in told]
    late = np.array(ahead) - np.array(early)
    print(f"{len(late)} notes, late by {1000 * np.median(late):.1f} ms in the median, {1000 * late.max():.1f} at most")
    print(said[-2000:], errors[-500:])
    if watch is not None:
        watch.send_signal(signal.SIGINT)
        stalled, dropouts = json.loads(watch.communicate()[0]), int(re.search(r"dropouts (\d+)", said)[1])
        count, longest = stalled["count"], stalled["longest"]
        print(f"{dropouts} dropouts; the machine was late {count} times, {longest:.1f} ms at most")
        assert dropouts <= count
        counted = late if dropouts == 0 else np.sort(late)[: int(0.95 * len(late))]  # a dropout delays what is near it
        assert counted.max() <= MOST_LATE
    again = tmp_path / "again.wav"
    assert run("replay", str(log), "-o", str(again), "--subtype", "FLOAT", timeout=3600.0).returncode == 0
    taken, repeated = soundfile.read(take, dtype="float32")[0], soundfile.read(again, dtype="float32")[0]
    np.testing.assert_array_equal(repeated, taken)
