"""MIDI files as people have them: what is broken is mended and said, and what is sound is read as ever."""

import io
import random
import sys
import time

import mido
import pytest
from conftest import ROOT
from smf import cc, events, lengths, meta, off, on, read, riff, smf, sysex, track

from engine.cli import main
from engine.live import midi_files
from engine.live.midi_drivers import MidiError
from engine.live.midi_files import is_midi_file, read_name
from engine.live.midi_reader import NotMidi, read_song

NOTE = [(0, on(60)), (480, off(60))]
ONE = [(60, 0.0, 0.5)]
TWO = [(0, on(60)), (480, off(60)), (100, on(62)), (480, off(62))]
BOTH = [(60, 0.0, 0.5), (62, 0.604, 0.5)]
CANON = ROOT / "docs" / "examples" / "canon.mid"

# --- what is odd and heard: the notes, and whether something is said of it

ODD = {
    "controller value 255": (smf(track((0, bytes([0xB0, 7, 0xFF])), *NOTE)), ONE, "a value beyond 127 (1)"),
    "velocity 200": (smf(track((0, on(60, 200)), NOTE[1])), ONE, "a value beyond 127 (1)"),
    "wheel bytes beyond 127": (smf(track((0, bytes([0xE0, 0xFF, 0xC0])), *NOTE)), ONE, "a value beyond 127 (1)"),
    "pressure of 255": (smf(track((0, bytes([0xD0, 0xFF])), *NOTE)), ONE, "a value beyond 127 (1)"),
    "a key of 200": (smf(track((0, on(200)), *NOTE)), ONE, "a key beyond 127 (1)"),
    "key signature of 18 flats": (smf(track((0, meta(0x59, bytes([238, 1]))), *NOTE)), ONE, ""),
    "key signature of mode 255": (smf(track((0, meta(0x59, bytes([254, 255]))), *NOTE)), ONE, ""),
    "empty key signature": (smf(track((0, meta(0x59)), *NOTE)), ONE, ""),
    "time signature of one byte": (smf(track((0, meta(0x58, b"\4")), *NOTE)), ONE, ""),
    "SMPTE offset of hour 99": (smf(track((0, meta(0x54, b"\x63\0\0\0\0")), *NOTE)), ONE, ""),
    "channel prefix of 200": (smf(track((0, meta(0x20, b"\xc8")), *NOTE)), ONE, ""),
    "unknown meta event": (smf(track((0, meta(0x60, b"abc")), *NOTE)), ONE, ""),
    "tempo of two bytes": (smf(track((0, meta(0x51, b"\7\xa1")), *NOTE)), ONE, "a tempo that is none (1)"),
    "tempo of four bytes": (smf(track((0, meta(0x51, b"\0\7\xa1\x20")), *NOTE)), ONE, "a tempo that is none (1)"),
    "RIFF around it": (riff(smf(track(*NOTE))), ONE, ""),
    "RIFF, and a list after it": (riff(smf(track(*NOTE))) + b"LIST\4\0\0\0INFO", ONE, ""),
    "MacBinary before it": (bytes(128) + smf(track(*NOTE)), ONE, "bytes before the header (128)"),
    "foreign chunk after the header": (smf(b"XFIH\0\0\0\4abcd", track(*NOTE)), ONE, ""),
    "foreign chunk between tracks": (smf(track(*TWO[:2]), b"XFKM\0\0\0\2ab", track((580, on(62)), TWO[3])), BOTH, ""),
    "foreign chunk at the end": (smf(track(*NOTE), b"CASM\0\0\0\4abcd"), ONE, ""),
    "foreign chunk cut off": (smf(track(*NOTE), b"CASM\0\0\xff\4abcd"), ONE, ""),
    "zeros between tracks": (
        smf(track(*TWO[:2]), bytes(3), track((580, on(62)), TWO[3])),
        BOTH,
        "bytes between tracks (3)",
    ),
    "last track cut off": (smf(track(*TWO))[:-8], [ONE[0], (62, 0.604, 1.0)], "a track that is cut off (1)"),
    "cut within a status": (smf(track(*TWO))[:-4], BOTH, "a track that is cut off (1)"),
    "second track cut off": (
        smf(track(*TWO[:2]), track((580, on(62)), TWO[3], (9, on(64))))[:-5],
        BOTH,
        "a track that is cut off (1)",
    ),
    "length of a track too large": (smf(track(*TWO[:2], length=9999), track((580, on(62)), TWO[3])), BOTH, "a wrong"),
    "length of a track too small": (smf(track(*TWO, length=12)), BOTH, "a wrong length of a track (1)"),
    "length of a track 0 of two": (smf(track(*TWO[:2], length=9), track((580, on(62)), TWO[3])), BOTH, "a wrong"),
    "running status after sysex": (
        smf(track((0, on(60)), (0, sysex(b"\x7e\x09\xf7")), (10, bytes([64, 80])), (480, off(60)), (0, off(64)))),
        [(60, 0.0, 0.51), (64, 0.01, 0.5)],
        "",
    ),
    "running status after a name": (
        smf(track((0, on(60)), (0, meta(3, b"a")), (480, bytes([60, 0])))),
        ONE,
        "",
    ),
    "running status at the start": (smf(track((0, bytes([60, 80])), *NOTE)), ONE, "bytes that are no events (3)"),
    "status that is none": (smf(track((0, b"\xf4"), *NOTE)), ONE, ""),
    "clock in a track": (smf(track((0, b"\xf8"), *NOTE)), ONE, ""),
    "sysex longer than its track": (smf(track((0, b"\xf0\xff\x7f\1\2"), *NOTE)), ONE, "bytes that are no events"),
    "sysex that does not end": (smf(track((0, sysex(b"\x41\x10\x42")), *NOTE)), ONE, ""),
    "name longer than its track": (smf(track((0, b"\xff\3\xff\x7fab"), *NOTE)), ONE, "bytes that are no events"),
    "a time of five bytes": (
        smf(b"MTrk" + (26).to_bytes(4, "big") + b"\xff\xff\xff\xff\x7f\xc0\5" + events(*NOTE) + b"\0\xff\x2f\0"),
        ONE,
        "bytes that are no events",
    ),
    "no end of track": (smf(track(*NOTE, end=False)), ONE, ""),
    "events after the end": (smf(track(*NOTE, (0, meta(0x2F)), (0, on(70)), (9, off(70)))), ONE, ""),
    "header of 8 bytes": (smf(track(*NOTE), extra=b"\0\0"), ONE, ""),
    "header that says 100 bytes": (
        smf(track(*NOTE)).replace(b"\0\0\0\6", b"\0\0\0\x64", 1),
        ONE,
        "length of the header (1)",
    ),
    "more tracks than the header says": (
        smf(track(*TWO[:2]), track((580, on(62)), TWO[3])).replace(b"\0\2\1\xe0", b"\0\1\1\xe0"),
        BOTH,
        "",
    ),
    "fewer tracks than the header says": (smf(track(*NOTE)).replace(b"\0\1\1\xe0", b"\0\x09\1\xe0"), ONE, ""),
    "25 frames of 40": (smf(track((0, on(60)), (500, off(60))), division=(256 - 25) << 8 | 40), ONE, ""),
    "24 frames of 4": (smf(track((0, on(60)), (48, off(60))), division=(256 - 24) << 8 | 4), ONE, ""),
    "30 frames of 80": (smf(track((0, on(60)), (1200, off(60))), division=(256 - 30) << 8 | 80), ONE, ""),
    "29.97 frames of 100": (
        smf(track((0, on(60)), (3000, off(60))), division=(256 - 29) << 8 | 100),
        [(60, 0.0, 1.001)],
        "",
    ),
    "SMPTE with a tempo": (
        smf(track((0, meta(0x51, b"\x0f\x42\x40")), (0, on(60)), (500, off(60))), division=(256 - 25) << 8 | 40),
        ONE,
        "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_is_heard(tmp_path, name):
    data, notes, said = ODD[name]
    file = read(data, tmp_path)
    assert lengths(file) == notes
    assert (said in file.mended) if said else not file.mended


@pytest.mark.hard
def test_what_was_mended_is_said_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = smf(track((0, cc(7, 255)), (0, cc(7, 200)), (0, on(200)), *TWO))[:-4]
    (tmp_path / "x.mid").write_bytes(data)
    for words in (["guitar"], ["guitar", "--play", "1=guitar"], [str(ROOT / "patches" / "piano_c4.toml")]):
        assert main.main(["render", *words, "--midi", "x.mid", "--seconds", "0.1", "-o", "a.wav"]) == 0
        (line,) = [line for line in capsys.readouterr().err.splitlines() if "mended" in line]
        mended = "a value beyond 127 (2), a key beyond 127 (1), a track that is cut off (1)"
        assert line == f"x.mid is broken, and was mended: {mended}"


REFUSED = {
    "no header": b"RIFF\0\0\0\0WAVE",
    "a header alone": smf(),
    "half a header": smf(track(*NOTE))[:11],
    "no ticks": smf(track(*NOTE), division=0),
    "SMPTE without ticks": smf(track(*NOTE), division=(256 - 25) << 8),
    "type 2": smf(track(*NOTE), kind=2),
    "no notes": smf(track((0, cc(7, 100)))),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_heard_is_refused_in_a_line(tmp_path, name):
    with pytest.raises(MidiError, match=r"x\.mid ") as found:
        read(REFUSED[name], tmp_path)
    assert "\n" not in str(found.value)


# --- what is sound


def messages_of_mido(file):
    """The messages on channels and the tempos of each track, with their ticks, as mido reads them."""
    for part in file.tracks:
        now, found = 0, []
        for message in part:
            now += message.time
            if message.type == "set_tempo":
                found.append((now, None, message.tempo))
            elif not message.is_meta and hasattr(message, "channel"):
                found.append((now, message.copy(time=0), None))
        yield found


def random_file(draw: random.Random) -> mido.MidiFile:
    """A file with all kinds of messages."""
    made = mido.MidiFile(type=1, ticks_per_beat=draw.choice([24, 96, 480, 960]))
    for number in range(draw.randint(1, 4)):
        part = mido.MidiTrack([mido.MetaMessage("track_name", name=f"Track {number}", time=draw.randrange(9))])
        for _ in range(draw.randrange(60)):
            told = {"channel": draw.randrange(16), "time": draw.choice([0, 0, 1, 200, 5000, 70_000])}
            value, key = draw.randrange(128), draw.randrange(128)
            part.append(
                draw.choice(
                    [
                        mido.Message("note_on", note=key, velocity=value, **told),
                        mido.Message("note_off", note=key, velocity=value, **told),
                        mido.Message("control_change", control=key, value=value, **told),
                        mido.Message("pitchwheel", pitch=draw.randrange(-8192, 8192), **told),
                        mido.Message("polytouch", note=key, value=value, **told),
                        mido.Message("aftertouch", value=value, **told),
                        mido.Message("program_change", program=value, **told),
                        mido.Message("sysex", data=[value] * draw.randrange(200), time=told["time"]),
                        mido.MetaMessage("set_tempo", tempo=draw.randrange(1 << 24), time=told["time"]),
                        mido.MetaMessage("lyrics", text="la", time=told["time"]),
                    ]
                )
            )
        made.tracks.append(part)
    return made


def saved(file: mido.MidiFile) -> bytes:
    data = io.BytesIO()
    file.save(file=data)
    return data.getvalue()


@pytest.mark.parametrize("seed", range(40))
def test_a_sound_file_is_read_as_mido_reads_it(seed):
    data = saved(random_file(random.Random(seed))) if seed else CANON.read_bytes()
    song, file = read_song(data), mido.MidiFile(file=io.BytesIO(data))
    assert [[tuple(event) for event in part.events] for part in song.tracks] == list(messages_of_mido(file))
    assert [read_name(part.name) for part in song.tracks] == [part.name for part in file.tracks]
    assert not song.mended and song.size == sum(map(len, file.tracks))


# --- mutated files


def mutated(data: bytes, draw: random.Random) -> bytes:
    """Bytes changed, left out, put in, repeated or cut off."""
    out = bytearray(data)
    for _ in range(draw.randint(1, 6)):
        at, length = draw.randrange(len(out) + 1), draw.choice([1, 1, 2, 5, 30])
        way = draw.randrange(6)
        if way == 0:
            out[at : at + length] = draw.randbytes(length)
        elif way == 1:
            del out[at : at + length]
        elif way == 2:
            out[at:at] = draw.randbytes(length)
        elif way == 3:
            out[at:at] = out[at : at + length]
        elif way == 4 and at < len(out):
            out[at] = draw.choice([0, 0x7F, 0x80, 0x90, 0xF0, 0xF7, 0xFF])
        elif draw.randrange(5) == 0:
            del out[at:]
        if not out:
            break
    return bytes(out)


@pytest.mark.hard
@pytest.mark.parametrize("count", [1000, pytest.param(20_000, marks=pytest.mark.hard)])
def test_mutated_files_neither_crash_nor_hang(count, tmp_path):
    """Each is read, or refused in a line; all notes are notes, and reading takes as long as that of a sound one."""
    draw, path = random.Random(67), tmp_path / "x.mid"
    sources = [data for data, _, _ in ODD.values()] + [saved(random_file(random.Random(n))) for n in range(20)]
    sources = [data for data in sources if len(data) < 1500]
    read_count, slowest = 0, 0.0
    for n in range(count):
        data = mutated(draw.choice(sources), draw)
        began = time.process_time()
        try:
            if n % 10:  # the reader alone, which is where bytes matter
                song = read_song(data)
                ticks = [event.ticks for part in song.tracks for event in part.events]
                assert all(tick >= 0 for tick in ticks)
            else:
                path.write_bytes(data)
                file = midi_files.read_notes(path)
                assert all(0 <= note.number <= 127 and note.seconds >= 0.0 for note in file.notes)
                assert all(length >= 0.0 for _, _, length in lengths(file))
            read_count += 1
        except (MidiError, NotMidi) as error:
            assert "\n" not in str(error)
        slowest = max(slowest, time.process_time() - began)
    assert read_count > count / 2 and slowest < 1.0


def test_a_large_file_of_noise_takes_seconds_at_most():
    """Reading on is tried from each byte, never twice from one."""
    noise = random.Random(1).randbytes(300_000)
    began = time.process_time()
    read_song(smf(b"MTrk" + len(noise).to_bytes(4, "big") + noise))
    assert time.process_time() - began < 10.0


# --- what counts as a file


@pytest.mark.hard
@pytest.mark.parametrize("name", ["a.mid", "a.MIDI", "a.kar", "a.smf", "a.rmi", "a song", "a.mid.bak"])
def test_a_file_of_any_name_is_one_everywhere(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(smf(track(*NOTE)))
    words = ["--midi", name, "--channels", "1", "--tracks", "0", "--seconds", "0.1"]
    assert main.main(["render", "guitar", *words, "-o", "a.wav"]) == 0
    assert is_midi_file(name)
    monkeypatch.setattr("engine.cli.live_session.play_patch", lambda args, scene: 0)
    assert main.main(["play", "guitar", *words]) == 0


def test_a_port_is_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Keys").mkdir()
    assert not any(is_midi_file(name) for name in ("Keys", "Midi Through", "", "no such file"))
    assert is_midi_file("none.kar") and is_midi_file("-")


@pytest.mark.hard_for("guitar")
@pytest.mark.parametrize("patch", ["guitar", str(ROOT / "patches" / "piano_c4.toml")])
def test_a_dash_reads_standard_input(tmp_path, monkeypatch, patch):
    monkeypatch.chdir(tmp_path)
    data = smf(track(*NOTE))
    (tmp_path / "midi.mid").write_bytes(data)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    midi_files._read_standard_input.cache_clear()
    assert main.main(["render", patch, "--midi", "-", "--seconds", "0.2"]) == 0
    assert main.main(["render", patch, "--midi", "midi.mid", "--seconds", "0.2", "-o", "b.wav"]) == 0
    (made,) = tmp_path.glob("midi_*.wav")
    assert made.read_bytes() == (tmp_path / "b.wav").read_bytes()
    midi_files._read_standard_input.cache_clear()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"")))
    assert main.main(["render", patch, "--midi", "-"]) == 2
    midi_files._read_standard_input.cache_clear()
