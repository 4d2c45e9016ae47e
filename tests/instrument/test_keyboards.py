"""Instruments: what a musician writes for all keys, and what each key then is."""

import contextlib
import copy
import json
import math
import random
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import engine
from engine.cli import main
from engine.instrument.key_names import note_frequency, parse_key, parse_keys
from engine.patch.note_scene import scene_of_note
from engine.patch.scene import scene_of_document

RATE = 44_100
STRINGS = """
title = "Two strings a key"

[keyboard]
keys = "C3..C5"

[keyboard.values]
length = { C3 = 1.0, C5 = 0.25 }
mass = "= 0.006*length"

[[key.body]]
name = "string"
kind = "string"
copies = 2
length = "= length"
mass = "= mass"
frequency = "= f * cents(pick(i, -1, 1))"
t60 = [3.0, 1.0]
t60_at = [200.0, 4000.0]
modes = 16

[[key.body]]
name = "hammer"
kind = "mass"
mass = { "C3..B3" = 9e-3, "C4..C5" = 7e-3 }
displacement = -0.05

[[key.contact]]
name = "felt"
body = "hammer"
on = "string"
on_at = 0.12
stiffness = 1e9
exponent = 2.5

[[key.pickup]]
body = "string"
at = 1.0
quantity = "end_force"
channel = "= 1 + (key > 62)"

[[key.on]]
kind = "strike"
body = "hammer"
displacement = -1e-3
velocity = "= 4*v"

[[key.on]]
kind = "change"
contact = "felt"
gap = "= 0.01 * (soft > 0.5) * (i == 1)"
duration = 0.0

[[key.damper]]
body = "string"
sigma = "= 20 + 20*release"
"""
SCORE = '[[note]]\ntime = 0.0\nkey = "C4"\nvelocity = 100\nduration = 0.4\n'


@pytest.fixture
def load(tmp_path):
    def load_text(text: str) -> engine.Scene:
        path = tmp_path / "strings.toml"
        path.write_text(text, "utf-8")
        return engine.load(path)

    return load_text


def faults_of(load, text: str) -> list[tuple[str, int | None, str]]:
    with pytest.raises(engine.PatchError) as error:
        load(text)
    return [(fault.path, fault.line, fault.message) for fault in error.value.faults]


def line_of(text: str, words: str) -> int:
    return text[: text.index(words)].count("\n") + 1


def fundamental(audio: np.ndarray, near: float) -> float:
    part = audio[RATE // 20 :] * np.hanning(len(audio) - RATE // 20)
    spectrum = np.abs(np.fft.rfft(part, 8 * len(part)))
    bins = np.arange(len(spectrum)) * RATE / (8 * len(part))
    inside = (bins > 0.97 * near) & (bins < 1.03 * near)
    return float(bins[inside][np.argmax(spectrum[inside])])


# --- values by key


def test_keys_have_the_names_and_pitches_that_musicians_give_them():
    assert [parse_key(name) for name in ("A0", "C4", "F#3", "Gb3", "C8", "C-1")] == [21, 60, 54, 54, 108, 0]
    assert list(parse_keys("C4..D4")) == [60, 61, 62]
    assert note_frequency(69) == 440.0 and note_frequency(60) == pytest.approx(261.6256, abs=1e-4)
    for wrong in ("H2", "C", "C4..", "D4..C4", "60"):
        with pytest.raises(ValueError, match=r"not a key|downwards"):
            parse_keys(wrong)


def test_every_number_of_a_key_follows_from_formulas_and_tables(load):
    scene = load(STRINGS + SCORE)
    bodies = {body.name: body for body in scene.body}
    assert list(bodies) == ["C4_string1", "C4_string2", "C4_hammer"]
    assert bodies["C4_string1"].length == pytest.approx(0.5)  # between 1 and a quarter by a constant ratio
    assert bodies["C4_string1"].mass == pytest.approx(0.003)
    assert bodies["C4_string2"].frequency / bodies["C4_string1"].frequency == pytest.approx(2 ** (2 / 1200))
    assert bodies["C4_hammer"].mass == 7e-3  # of its range of keys
    assert [(c.name, c.body, c.on) for c in scene.contact] == [
        ("C4_felt1", "C4_hammer", "C4_string1"),
        ("C4_felt2", "C4_hammer", "C4_string2"),
    ]


@pytest.mark.parametrize("key", ["C3", "G3", "C5"])
def test_each_key_sounds_at_its_pitch(load, key):
    audio = engine.render(scene_of_note(load(STRINGS), key, 80, 1.0, 1.0)).audio.sum(axis=1)
    assert (
        abs(1200 * math.log2(fundamental(audio, note_frequency(parse_key(key))) / note_frequency(parse_key(key)))) < 3
    )


def test_a_faster_key_is_louder_and_brighter(load):
    sounds = [engine.render(scene_of_note(load(STRINGS), "C4", v, 0.5, 0.5)).audio[:, 0] for v in (30, 120)]
    spectra = [np.abs(np.fft.rfft(sound)) ** 2 for sound in sounds]
    high = [spectrum[1000:].sum() / spectrum.sum() for spectrum in spectra]  # above 2 kHz
    assert spectra[1].sum() > 4 * spectra[0].sum() and high[1] > 2 * high[0]


def test_a_note_alone_is_the_same_bits_as_in_company(load):
    """Nothing is shared here: C4 is heard on the left, E4 on the right."""
    alone = engine.render(load(STRINGS + SCORE), seconds=1.0).audio
    company = SCORE + '[[note]]\ntime = 0.1\nkey = "E4"\nduration = 0.3\n'
    together = engine.render(load(STRINGS + company), seconds=1.0).audio
    assert np.array_equal(alone[:, 0], together[:, 0]) and np.abs(together[:, 1]).max() > 0.0


# --- dampers and pedals


def rms(audio: np.ndarray) -> float:
    return float(np.sqrt(np.mean(audio**2)))


def part(load, seconds: float, *pedals: str) -> np.ndarray:
    """A tenth of a second from a time on, of a key that is let go at 0.4 s."""
    audio = engine.render(load(STRINGS + SCORE + "\n".join(pedals)), seconds=1.2).audio[:, 0]
    return audio[round(seconds * RATE) :][: RATE // 10]


def test_dampers_come_down_with_the_key_and_the_pedal_holds_them(load):
    free = part(load, 0.6, "[[pedal]]\ntime = 0.2\nsustain = 1.0")
    half = part(load, 0.6, "[[pedal]]\ntime = 0.2\nsustain = 0.5")
    damped, sigma = part(load, 0.6), 20 + 20 * 64 / 127
    decay = np.exp(-sigma * (0.2 + np.arange(free.size) / RATE))  # since the key was let go
    assert rms(damped) == pytest.approx(rms(free * decay), rel=0.02)
    assert rms(half) == pytest.approx(rms(free * np.sqrt(decay)), rel=0.02)
    assert np.array_equal(part(load, 0.3), part(load, 0.3, "[[pedal]]\ntime = 0.2\nsustain = 1.0"))


def test_sostenuto_keeps_the_keys_that_are_down(load):
    kept = part(load, 1.0, "[[pedal]]\ntime = 0.2\nsostenuto = 1.0")
    late = part(load, 1.0, "[[pedal]]\ntime = 0.5\nsostenuto = 1.0")
    assert rms(late) < 1e-4 * rms(kept)


def test_una_corda_strikes_one_string_less(load):
    def largest_forces(pedal: str) -> np.ndarray:
        return engine.render(load(STRINGS + pedal + SCORE), seconds=0.2, trace=True).trace["force"].max(axis=0)

    assert largest_forces("").min() > 1.0
    first, second = largest_forces("[[pedal]]\ntime = 0.0\nsoft = 1.0\n")
    assert first == 0.0 and second > 1.0


def test_keys_of_one_string_sound_one_at_a_time(load):
    text = STRINGS.replace('keys = "C3..C5"', 'keys = "C3..C5"\nmono = "string"').replace(
        'mass = "= 0.006*length"', 'mass = "= 0.006*length"\nstring = { "C3..E4" = 1, "F4..C5" = 2 }'
    )
    held = '[[note]]\ntime = 0.0\nkey = "C4"\nduration = 1.0\n[[note]]\ntime = 0.4\nkey = "{}"\nduration = 0.5\n'
    ends = []
    for key in ("D4", "G4"):
        damped = [e for e in load(text + held.format(key)).event if e.kind == "damp" and e.body == "C4_string1"]
        ends.append([event.time for event in damped if event.time > 0.0])  # at first, all are down
    assert ends == [[0.4], [1.0]]


# --- what is wrong is said, at its line


@pytest.mark.parametrize(
    ("old", "new", "path", "says"),
    [
        ('mass = "= mass"', 'mass = "= masss"', "key.body[0].mass", "unknown name masss; the names are key, n"),
        ('mass = "= mass"', 'mass = "= mass +"', "key.body[0].mass", "not an arithmetic expression"),
        ('mass = "= mass"', 'mass = "= log(mass - 1)"', "key.body[0].mass", "it has no value"),
        ('mass = "= mass"', 'mass = "= -mass"', "key.body[0].mass", "(key C4)"),
        ('mass = "= mass"', 'mass = "= 10**10**10"', "key.body[0].mass", "it has no value"),
        ('mass = "= mass"', "mass = \"= open('x')\"", "key.body[0].mass", "unknown function open"),
        ('mass = "= mass"', 'mass = "= f.real.__class__"', "key.body[0].mass", "f.real.__class__ is not arithmetic"),
        ('"C4..C5" = 7e-3', '"E4..C5" = 7e-3', "key.body[1].mass", "no range contains key C4"),
        ("copies = 2", "copies = 99", "key.body[0].copies", "0 to 8"),
        ("displacement = -0.05", "displacment = -0.05", "key.body[1].displacment", 'did you mean "displacement"?'),
        ('on = "string"', 'on = "strng"', "key.contact[0].on", "strng"),
        ('keys = "C3..C5"', 'keys = "C3-C5"', "keyboard.keys", '"C3-C5" is not a key'),
        ('keys = "C3..C5"', 'keys = "E4..C5"', "note[0].key", "the instrument has no key C4; E4 to C5"),
        ("[[key.damper]]", "[[key.dampers]]", "key.dampers", 'did you mean "damper"?'),
        ("length = { C3 = 1.0, C5 = 0.25 }", 'length = "long"', "keyboard.values.length", "not a number"),
        ('keys = "C3..C5"', "keys = []", "keyboard.keys", 'no key; text such as "A0..C8"'),
        ('keys = "C3..C5"', 'mono = "course"\nkeys = "C3..C5"', "keyboard.mono", "no value has this name; one of"),
        ('keys = "C3..C5"', 'drums = { 38 = "D2" }\nkeys = "C3..C5"', "keyboard.drums", "has no key D2; C3 to C5"),
    ],
)  # fmt: skip
def test_faults_are_told_at_their_line_and_once_for_all_keys(load, old, new, path, says):
    assert old in STRINGS
    text = STRINGS.replace(old, new) + SCORE
    faults = [fault for fault in faults_of(load, text) if fault[0] == path]
    assert len(faults) == 1 and says in faults[0][2], faults_of(load, text)
    if new in text and path != "note[0].key":
        assert faults[0][1] == line_of(text, new)


def test_a_pedal_that_nothing_moves_is_refused(load):
    faults = faults_of(load, STRINGS + SCORE + "[[pedal]]\ntime = 0.1\n")
    assert [(path, "give sustain, soft or sostenuto" in says) for path, _, says in faults] == [("pedal[0]", True)]


ONLY_THE_LOW_KEYS = ("length = { C3 = 1.0, C5 = 0.25 }", 'length = { "C3..C4" = 1.0 }')
NONE_AT_THE_TOP = ('mass = { "C3..B3" = 9e-3, "C4..C5" = 7e-3 }', "mass = { C3 = 9e-3, C4 = 7e-3, C5 = 0.0 }")


@pytest.mark.parametrize(
    ("change", "key", "says"),
    [
        (ONLY_THE_LOW_KEYS, "D4", "keyboard.values.length: no range contains key C#4; ranges for all keys"),
        (NONE_AT_THE_TOP, "C5", "key.body[1].mass: 0.0 is out of range"),
    ],
)
def test_a_fault_of_a_key_that_the_score_does_not_play_is_told_at_its_line(tmp_path, capsys, change, key, says):
    """By whatever wants all keys, or that key: checks, levels, pages, and single notes."""
    text = STRINGS.replace(*change) + SCORE
    patch = tmp_path / "strings.toml"
    patch.write_text(text, "utf-8")
    where = f"{patch}:{line_of(text, change[1])} "
    for words in (["check"], ["level"], ["export", "-o", str(tmp_path / "a.html")], ["inspect", "--key", key]):
        assert main.main([words[0], str(patch), *words[1:]]) == 2
        said = capsys.readouterr().err
        assert said.startswith(where + says.replace("C#4", key if words[0] == "inspect" else "C#4")), said
    scene = engine.load(patch)
    for call in (engine.export_page, lambda scene: scene_of_note(scene, key)):
        with pytest.raises(engine.PatchError) as refused:
            call(scene)
        assert [fault.path for fault in refused.value.faults] == [says.partition(":")[0]]


WRONG_VALUES: list[Any] = [[], [1, 2], {}, {"a": 1}, "x", "= 1/0", True, math.inf, -1, 10**30, {"C4": "x"}, [[1]], "C4"]


@pytest.mark.hard_for("1", "0", "3")
@pytest.mark.parametrize("seed", range(4))
def test_an_instrument_with_values_of_a_wrong_kind_is_refused(load, seed):
    """Wherever they stand, of tables as well as of numbers."""
    chance = random.Random(seed)
    for _ in range(100):
        document = tomllib.loads(STRINGS + SCORE)
        table, key = chance.choice(list(places_in(document)))
        table[key] = copy.deepcopy(chance.choice(WRONG_VALUES))
        with contextlib.suppress(engine.PatchError):
            scene_of_document(document, Path(), "strings.toml")


def places_in(table: Any) -> Iterator[tuple[Any, Any]]:
    """All tables and lists of a document, each with each of its keys."""
    for key, value in list(table.items() if isinstance(table, dict) else enumerate(table)):
        yield table, key
        if isinstance(value, dict | list):
            yield from places_in(value)


def test_the_numbers_of_a_key_are_printed(load, tmp_path, capsys):
    load(STRINGS)
    assert main.main(["inspect", str(tmp_path / "strings.toml"), "--key", "C4", "--json"]) == 0
    listing = json.loads(capsys.readouterr().out)
    assert listing["values"]["length"] == pytest.approx(0.5) and listing["values"]["f"] == pytest.approx(261.6256)
    assert [body["name"] for body in listing["body"]] == ["C4_string1", "C4_string2", "C4_hammer"]
    assert listing["on"][0]["velocity"] == pytest.approx(4 * 80 / 127)
    assert main.main(["inspect", str(tmp_path / "strings.toml"), "--key", "C4"]) == 0
    assert "length = 0.5" in capsys.readouterr().out
    assert main.main(["inspect", str(tmp_path / "strings.toml"), "--key", "C7"]) == 2
    assert "the instrument has no key C7; C3 to C5" in capsys.readouterr().err
    assert main.main(["inspect", "bouncing_ball", "--key", "C4"]) == 2
    assert "not an instrument" in capsys.readouterr().err
