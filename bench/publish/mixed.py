"""A piece for three instruments: its MIDI file, the sound of `fdh render --play`, and its place in the gallery."""

import re
import tempfile
from pathlib import Path
from typing import Any

import soundfile

from bench.publish.pieces import PIECES
from bench.publish.report import ROOT
from bench.publish.sounds import SOUNDS, compress
from engine.cli.main import main as fdh
from engine.instrument.score import Score

FILE, SOUND = ROOT / "docs" / "examples" / "canon.mid", SOUNDS / "canon_mix.ogg"
PROGRAMS = {"guitar": 24, "violin": 40, "marimba": 12}  # of General MIDI, from 0; each part is a track on a channel
COMMAND = "fdh render guitar --midi docs/examples/canon.mid --play violin=violin,marimba=marimba_keys@1"
TICKS = 480  # of a beat of half a second
PLACE = re.compile(r"<!-- mixed -->\n.*?<!-- /mixed -->", re.DOTALL)
TEXT = """**Three instruments, one MIDI file:** {about}.
[canon_mix.ogg](audio/canon_mix.ogg) is the sound of this command, which gives the tracks `violin` and `marimba` of
[canon.mid](examples/canon.mid) to other patches ([MIDI files](instruments.md#midi-files)):

```sh
uv run {command}
```
"""


def make() -> None:
    """Write the MIDI file, and render it."""
    write_midi(PIECES["canon"].parts, FILE)
    with tempfile.TemporaryDirectory() as folder:
        wave = Path(folder) / "mix.wav"
        words = [str(ROOT / word) if word.endswith(".mid") else word for word in COMMAND.split()[1:]]
        if code := fdh([*words, "-o", str(wave)]):
            raise RuntimeError(f"fdh returned {code}")
        audio, samplerate = soundfile.read(wave, always_2d=True)
    compress(audio, samplerate, SOUND)


def insert(page: str) -> str:
    """Return a page with the piece in its place."""
    text = TEXT.format(about=PIECES["canon"].about, command=COMMAND)
    return PLACE.sub(f"<!-- mixed -->\n{text}<!-- /mixed -->", page)


def write_midi(parts: dict[str, Score], path: Path) -> None:
    """Write parts as a MIDI file of type 1: a track and a channel for each, with its name and its program."""
    import mido

    file = mido.MidiFile(type=1, ticks_per_beat=TICKS)
    for channel, (name, program) in enumerate(PROGRAMS.items()):
        start: dict[str, Any] = {"program": program, "channel": channel}
        track = mido.MidiTrack([mido.MetaMessage("track_name", name=name), mido.Message("program_change", **start)])
        events = [(note.time, 1, note.key, note.velocity) for note in parts[name].notes]
        events += [(note.end, 0, note.key, note.release) for note in parts[name].notes]
        at = 0
        for time, is_on, key, velocity in sorted(events):
            tick = round(time * 2 * TICKS)
            kind = "note_on" if is_on else "note_off"
            track.append(mido.Message(kind, note=key, velocity=velocity, channel=channel, time=tick - at))
            at = tick
        file.tracks.append(track)
    file.save(path)
