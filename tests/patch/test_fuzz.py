"""Files that were damaged at random: each is read, or refused in one line. FDH_FUZZ_SEED tries others."""

import copy
import csv
import io
import json
import os
import random
import warnings

import numpy as np
import pytest
import soundfile
from conftest import ROOT
from sweeps import plan

import engine
from engine.bodies.csv_files import read_modes as measured
from engine.faults import PatchError
from engine.live import midi_drivers, midi_files
from engine.live.player import Player
from engine.live.replay import read_log, replay
from engine.patch.scene import load
from engine.sweep import index_csv

pytestmark = pytest.mark.hard
SEED = int(os.environ.get("FDH_FUZZ_SEED", "1"))
INTERESTING = [0, 1, -1, 2**31, 2**63, 2**70, -(2**70), 1e308, 1e-320, 0.5, "", "x", None, True, [], {}, "1e999"]
TEXTS = ["\0", '"', ",", "\n", "\r", "nan", "inf", "-1", "1e999", "9" * 400, "é", "../", "x" * 140_000, "=", "#"]


def damaged(data: bytes, draw: random.Random) -> bytes:
    """The same with some bytes changed, left out, put in or repeated."""
    found = bytearray(data)
    for _ in range(draw.choice([1, 1, 2, 4, 16])):
        at, kind = draw.randrange(len(found) + 1), draw.randrange(6)
        length = draw.choice([1, 1, 2, 4, 30])
        if kind == 0:
            found[at : at + 1] = bytes([draw.randrange(256)])
        elif kind == 1:
            found[at : at + length] = b""
        elif kind == 2:
            found[at:at] = draw.randbytes(length)
        elif kind == 3:
            found[at : at + length] = draw.choice([b"\0", b"\xff", b"\x7f", b"\x80"]) * length
        elif kind == 4:
            found[at:at] = found[at : at + length * 8]
        else:
            del found[at:]
    return bytes(found)


def retold(text: str, draw: random.Random) -> str:
    """The same with some words put in, or lines doubled."""
    for _ in range(draw.choice([1, 1, 2, 4])):
        at = draw.randrange(len(text) + 1)
        end = at + draw.choice([0, 0, 1, 3])
        text = text[:at] + draw.choice(TEXTS) + text[end:]
    return text


def one_line(error: Exception) -> None:
    assert str(error) and "\n" not in str(error), repr(error)


def notes(draw: random.Random) -> bytes:
    """A MIDI file of some tracks, with all kinds of messages."""
    mido = pytest.importorskip("mido")
    tracks = []
    for _ in range(draw.randint(1, 3)):
        track = mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=draw.randint(1, 10**6))])
        track += [mido.MetaMessage("key_signature", key="Bb"), mido.MetaMessage("time_signature", numerator=3)]
        track += [mido.MetaMessage("track_name", name="one"), mido.Message("sysex", data=(1, 2, 3))]
        for _ in range(draw.randint(1, 8)):
            track += [mido.Message("note_on", note=draw.randint(0, 127), velocity=draw.randint(0, 127), time=90)]
            track += [mido.Message("control_change", control=64, value=draw.randint(0, 127), time=5)]
            track += [mido.Message("pitchwheel", pitch=100), mido.MetaMessage("smpte_offset", hours=1)]
        tracks.append(track)
    file = io.BytesIO()
    mido.MidiFile(type=1, tracks=tracks, ticks_per_beat=draw.choice([1, 96, 480])).save(file=file)
    return file.getvalue()


def test_midi_files(tmp_path):
    draw, path, good = random.Random(SEED), tmp_path / "a.mid", 0
    for _ in range(2000):
        path.write_bytes(damaged(notes(draw), draw))
        try:
            found = midi_files.read_notes(path).notes
        except midi_drivers.MidiError as error:
            one_line(error)
            continue
        good += 1
        assert all(0.0 <= note.seconds <= midi_files.MAX_FILE_SECONDS and 0 <= note.number <= 127 for note in found)
        assert [note.seconds for note in found] == sorted(note.seconds for note in found)
    assert 50 < good < 1950


@pytest.fixture(scope="module")
def log():
    player = Player(engine.load(ROOT / "patches" / "piano_c4.toml"), gain=0.1, voices=1, lowest=0.5)
    player.strike("hammer_0", 2.0)
    player.tune(0, 0.7, frame=100)
    player.damp("string_0", frame=200)
    player.set("contact.felt_0.stiffness", 1e9, frame=300)
    player.render_into(np.zeros((500, player.channels), np.float32))
    return json.loads(json.dumps(player.log()))


def meddled(told, draw: random.Random):
    """The same with another value somewhere."""
    told = copy.deepcopy(told)
    for _ in range(draw.choice([1, 1, 2])):
        here = told["events"] if draw.random() < 0.6 and isinstance(told.get("events"), list) else told
        while True:
            keys = list(range(len(here))) if isinstance(here, list) else list(here)
            if not keys:
                break
            key = draw.choice(keys)
            if isinstance(here[key], dict | list) and draw.random() < 0.8:
                here = here[key]
                continue
            if draw.random() < 0.15:
                del here[key]
            else:
                here[key] = copy.deepcopy(draw.choice(INTERESTING))
            break
    return told


def test_logs(log, tmp_path):
    """Those that are still logs are replayed, unless they are of long or many sounds."""
    draw, path, good = random.Random(SEED), tmp_path / "log.json", 0
    for n in range(500):
        text = json.dumps(meddled(log, draw) if n % 2 else log)
        path.write_text(text if n % 2 else retold(text, draw), "utf-8", "replace")
        try:
            told = read_log(path)
            if min(told.frames, told.end) < 10_000 and told.voices < 8 and told.samplerate < 100_000:
                replay(told)
                good += 1
        except (OSError, ValueError) as error:
            assert str(error)
    assert 20 < good < 480


def test_tables_of_modes(tmp_path):
    """CSV files that a patch names."""
    draw, path, good = random.Random(SEED), tmp_path / "bell.csv", 0
    patch = tmp_path / "p.toml"
    patch.write_text(
        '[[body]]\nname = "b"\nkind = "modes"\nfile = "bell.csv"\n[[pickup]]\nbody = "b"\nat = "rim"\n'
        '[[force]]\nkind = "constant"\nbody = "b"\nat = "rim"\namplitude = 1.0\n'
    )
    text = "frequency,t60,rim\n" + "".join(f"{100.0 * n},{2.0 / n},{0.1 * n}\n" for n in range(1, 9))
    path.write_text(text, "utf-8")
    load(str(patch))
    for n in range(500):
        if n % 2:
            path.write_bytes(damaged(text.encode(), draw))
        else:
            path.write_text(retold(text, draw), "utf-8", newline="")
        try:
            load(str(patch))
            measured(path)
            good += 1
        except PatchError as error:
            assert all(str(fault) and "\n" not in str(fault) for fault in error.faults)
    assert 20 < good < 480


def test_indexes(tmp_path):
    """Whatever an index holds, its rows are whole, and it can be written again."""
    draw, path = random.Random(SEED), tmp_path / "index.csv"
    paths = [axis.path for axis in plan("body.marble.displacement=1e-4..1e-3:log:3").axes]
    header = index_csv.index_header(paths)
    rows = []
    for n in range(1, 9):
        told = {"number": n, "file": f"{n:04d}_mass=1.wav", "status": "done", "fingerprint": f"{n:012x}"}
        rows.append(index_csv.csv_line(index_csv.format_cell(told.get(column, 0.5)) for column in header))
    text = index_csv.csv_line(header) + "".join(rows)
    kept = 0
    for n in range(500):
        if n % 2:
            path.write_bytes(damaged(text.encode(), draw))
        else:
            path.write_text(retold(text, draw), "utf-8", newline="")
        if index_csv.check_index(path, paths):
            continue
        for number, row in index_csv.read_index(path).items():
            assert 0 <= number < 10**9 and None not in row.values()
            kept += 1
        index_csv.write_index(path, header, index_csv.read_index(path))
        assert all(len(row) == len(header) for row in csv.reader(path.open(newline="", encoding="utf-8")))
    assert kept > 500


def test_sounds_of_forces(tmp_path):
    """WAV files that a patch is driven by: the scene is refused, or rendered."""
    draw, path, good = random.Random(SEED), tmp_path / "push.wav", 0
    patch = tmp_path / "p.toml"
    patch.write_text(
        'seconds = 0.01\n[[body]]\nname = "b"\nkind = "oscillator"\nmass = 1.0\nfrequency = 440.0\n'
        '[[force]]\nkind = "file"\nbody = "b"\nfile = "push.wav"\namplitude = 1.0\n[[pickup]]\nbody = "b"\n'
    )
    for _ in range(200):
        kind = draw.choice(["FLOAT", "PCM_16", "DOUBLE", "PCM_24"])
        soundfile.write(path, 0.5 * np.sin(np.arange(300) / 9), draw.choice([4000, 44_100]), kind)
        path.write_bytes(damaged(path.read_bytes(), draw))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                engine.render(load(str(patch)))
            good += 1
        except PatchError as error:
            assert all(str(fault) and "\n" not in str(fault) for fault in error.faults)
        except ValueError as error:
            one_line(error)
    assert 5 < good < 195
