"""Descriptions of sounds in their files, as another program reads them."""

import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile

from engine.sound.about import About, Marker
from engine.sound.form import PLAIN_FORM, SoundForm
from engine.sound.sound_file import SoundFile

TONE = np.sin(0.1 * np.arange(48_001))[:, None]
ABOUT = About(
    "Bowl & spoon", "bowl.toml", 'title = "Bowl & spoon"\n', {"contact.rim.loss": "0.1 < x"}, "general", 57, 90.0
)


def written(folder: Path, about: About = ABOUT, form: SoundForm = PLAIN_FORM, name: str = "a.wav") -> Path:
    SoundFile(folder / name, form, about).prepare(TONE, 48_000).write()
    return folder / name


def chunks(path: Path) -> dict[bytes, bytes]:
    """The chunks of a file, as any reader of RIFF finds them."""
    data, at, found = path.read_bytes(), 12, {}
    assert struct.unpack("<I", data[4:8])[0] == len(data) - 8
    while at < len(data):
        name, size = data[at : at + 4], struct.unpack("<I", data[at + 4 : at + 8])[0]
        found[name + data[at + 8 : at + 12] if name == b"LIST" else name] = data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2
    return found


def test_a_reader_of_broadcast_wave_finds_the_patch_and_its_values(tmp_path):
    wavinfo = pytest.importorskip("wavinfo")
    found = wavinfo.WavInfoReader(str(written(tmp_path)))
    assert found.info.title == "Bowl & spoon" and found.info.software.startswith("fdh ")
    assert found.info.comment == "patch bowl.toml; contact.rim.loss = 0.1 < x"
    assert found.bext.description == "Bowl & spoon - patch bowl.toml; contact.rim.loss = 0.1 < x"
    assert found.bext.originator.startswith("fdh ") and found.bext.originator_date == ""
    user = found.ixml.parsed.find("USER")
    assert user.find("FDH_PATCH").text == ABOUT.text and user.find("FDH_KERNEL").text == "general"
    assert {v.get("NAME"): v.text for v in user.findall("FDH_VALUE")} == dict(ABOUT.values)
    assert [track.channel_index for track in found.ixml.track_list] == ["1"]


def test_the_sound_is_the_same_with_and_without(tmp_path):
    SoundFile(tmp_path / "plain.wav").prepare(TONE, 48_000).write()
    for name in ("plain.wav", "a.wav"):
        audio, _ = soundfile.read(written(tmp_path) if name == "a.wav" else tmp_path / name)
        np.testing.assert_array_equal(audio, soundfile.read(tmp_path / "plain.wav")[0])


@pytest.mark.parametrize("kind", ["flac", "ogg", "mp3", "aiff", "caf"])
def test_files_of_other_formats_say_it_in_their_tags(tmp_path, kind):
    """As libsndfile reads them; the sound is the same as without, and equal sounds are equal files."""
    path = written(tmp_path, name=f"a.{kind}")
    with soundfile.SoundFile(path) as file:
        assert file.title == "Bowl & spoon"
        assert file.comment == "patch bowl.toml; contact.rim.loss = 0.1 < x; kernel general"
        assert kind == "mp3" or file.software.startswith("fdh ")
        audio = file.read()
    SoundFile(tmp_path / f"plain.{kind}").prepare(TONE, 48_000).write()
    np.testing.assert_array_equal(audio, soundfile.read(tmp_path / f"plain.{kind}")[0])
    assert path.read_bytes() == written(tmp_path, name=f"b.{kind}").read_bytes()


@pytest.mark.parametrize("kind", ["au", "w64"])
def test_a_format_without_texts_holds_the_sound_alone(tmp_path, kind):
    assert soundfile.info(written(tmp_path, name=f"a.{kind}")).frames == len(TONE)


def test_a_sampler_finds_the_key_and_the_loop(tmp_path):
    found = chunks(written(tmp_path, form=SoundForm(loop=0.25)))[b"smpl"]
    assert struct.unpack("<I", found[8:12])[0] == round(1e9 / 48_000)
    assert struct.unpack("<I", found[12:16])[0] == 57
    assert struct.unpack("<I", found[28:32])[0] == 1
    _, kind, begin, end = struct.unpack("<4I", found[36:52])
    assert (kind, begin, end) == (0, 0, 48_001 - 12_000 - 1)
    assert b"smpl" not in chunks(written(tmp_path, About("no key")))


def test_markers_are_cues_with_names(tmp_path):
    found = chunks(written(tmp_path, About(markers=(Marker(0.0, "bar 1"), Marker(0.5, "bar 2")))))
    assert struct.unpack("<I", found[b"cue "][:4])[0] == 2
    assert struct.unpack("<I", found[b"cue "][4 + 24 + 20 : 4 + 24 + 24])[0] == 24_000
    assert b"bar 2\0" in found[b"LISTadtl"]


def test_equal_sounds_are_equal_files(tmp_path):
    assert written(tmp_path).read_bytes() == written(tmp_path, name="b.wav").read_bytes()


@pytest.mark.parametrize("name", ["a.flac", "a.ogg", "a.aiff"])
def test_files_of_other_formats_are_read(tmp_path, name):
    path = written(tmp_path, name=name)
    assert soundfile.info(str(path)).frames == 48_001
