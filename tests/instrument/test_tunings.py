"""Tunings of instruments: Scala files give the frequencies of the keys, and keys that a map leaves out are silent."""

import json
import math
import random
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.cli.main import main
from engine.faults import PatchError, PatchWarning
from engine.instrument.expansion import keys_of
from engine.instrument.key_names import note_frequency, note_name, plain_note_name
from engine.instrument.scala_files import (
    ScalaError,
    frequencies_of_keys,
    map_from_middle_c,
    read_keyboard_map,
    read_scale,
)
from engine.live.instrument_notes import scene_of_file
from engine.live.key_allocator import live_scene
from tests.live.smf import off, on, smf, track

MEANTONE = """! meantone.scl
!
Quarter-comma meantone (Aaron, 1523): pure thirds, fifths of 696.578 cents
 12
!
 76.04900
 193.15686
 310.26471
 5/4
 503.42157
 579.47057
 696.57843
 25/16
 889.73529
 1006.84314
 1082.89214
 2/1
"""
WERCKMEISTER = """Werckmeister III (1691)
12
256/243
192.18
32/27
390.225
4/3
1024/729
696.09
128/81
888.27
16/9
1092.18
2/1
"""
TWELFTH = 1200 * math.log2(3)
BOHLEN_PIERCE = "Bohlen-Pierce\n13\n" + "".join(f"{TWELFTH * n / 13:.10f}\n" for n in range(1, 14))
SLENDRO = "Slendro of Surakarta (Kunst, 1949), measured\n5\n 231.0 of the octave\n 474.0\n 717.0\n 955.0\n 1208.0\n"
SCALES = {"meantone": MEANTONE, "werckmeister": WERCKMEISTER, "bohlen_pierce": BOHLEN_PIERCE, "slendro": SLENDRO}
FIVE_KEYS = "! C D F G A\n12\n0\n127\n60\n60\n261.6\n5\n0\nx\n1\nx\nx\n2\nx\n3\nx\n4\nx\nx\n"
WHITE_KEYS = "! white keys of C major\n12\n0\n127\n60\n69\n432.0\n12\n0\nx\n2\nx\n4\n5\nx\n7\nx\n9\nx\n11\n"
INSTRUMENTS = [path for path in sorted((ROOT / "patches").rglob("*.toml")) if engine.load(path).instrument]
DRUMS = ("kit", "snare", "toms", "drum")  # have pitches of their own

OSCILLATORS = {
    "keyboard": {"keys": "C3..C6"},
    "key": {
        "body": [{"name": "bar", "kind": "oscillator", "mass": 1e-3, "frequency": "= f", "damping_rate": 1.0}],
        "on": [{"kind": "pluck", "body": "bar", "amplitude": "= v", "duration": 1e-3}],
        "pickup": [{"body": "bar"}],
    },
    "note": [{"time": 0.0, "key": "C4"}, {"time": 0.0, "key": "C#4"}],
}


def saved(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "latin-1")
    return path


def cents(one: float, other: float) -> float:
    return abs(1200.0 * math.log2(one / other))


# --- what the files say


@pytest.mark.parametrize("name", SCALES)
def test_keys_have_the_frequencies_that_another_reader_finds(name):
    """Surge's library reads the same files, with a map of seven keys and without: within 1e-9 cents."""
    library = pytest.importorskip("tuning_library")
    scale = library.parse_scl_data(SCALES[name])
    found = frequencies_of_keys(read_scale(SCALES[name]), map_from_middle_c(440.0), 440.0)
    assert max(cents(found[key], library.Tuning(scale).frequency_for_midi_note(key)) for key in range(128)) < 1e-9
    if name in ("meantone", "werckmeister"):
        tuning = library.Tuning(scale, library.parse_kbm_data(WHITE_KEYS))
        mapped = frequencies_of_keys(read_scale(SCALES[name]), read_keyboard_map(WHITE_KEYS), 440.0)
        assert set(mapped) == {key for key in range(128) if tuning.is_midi_note_mapped(key)}
        assert max(cents(mapped[key], tuning.frequency_for_midi_note(key)) for key in mapped) < 1e-9


def test_random_scales_and_maps_are_read_as_another_reader_reads_them():
    library = pytest.importorskip("tuning_library")
    for seed in range(200):
        rng = random.Random(seed)
        count = rng.randint(1, 24)
        tones = sorted(rng.uniform(1.0, 1900.0) for _ in range(count))
        text = f"!\nrandom {seed}\n{count}\n" + "".join(f" {tone:.6f} tone\n" for tone in tones)
        size, middle = rng.choice([0, 5, 12, 17]), rng.randint(40, 80)
        reference = middle + rng.randrange(max(1, size))  # in the first pattern: beyond, that library reads otherwise
        degrees = [str(rng.randrange(count)) if rng.random() < 0.8 else "x" for _ in range(size)]
        if size and degrees[(reference - middle) % size] == "x":
            degrees[(reference - middle) % size] = "0"
        head = [size, 0, 127, middle, reference, f"{rng.uniform(100, 900):.4f}", count]
        keys = "\n".join(map(str, [*head, *degrees])) + "\n"
        try:
            tuning = library.Tuning(library.parse_scl_data(text), library.parse_kbm_data(keys))
        except library.TuningError:
            continue
        found = frequencies_of_keys(read_scale(text), read_keyboard_map(keys), 440.0)
        assert set(found) == {key for key in range(128) if tuning.is_midi_note_mapped(key)}, (text, keys)
        worst = max(cents(f, tuning.frequency_for_midi_note(key)) for key, f in found.items() if 1e-3 < f < 1e6)
        assert worst < 1e-7, (text, keys)


def test_a_map_rises_by_the_interval_of_its_octave_where_it_repeats():
    """As the format says: by that of a degree; Surge's library takes the last one of the scale instead."""
    keys = "2\n0\n127\n60\n60\n300.0\n2\n0\n1\n"
    found = frequencies_of_keys(read_scale("s\n3\n100.0\n300.0\n700.0\n"), read_keyboard_map(keys), 440.0)
    above = [round(1200 * math.log2(found[key] / 300.0), 6) for key in (58, 59, 60, 61, 62, 63, 64)]
    assert above == [-300.0, -200.0, 0.0, 100.0, 300.0, 400.0, 600.0]


def test_keys_beyond_a_map_stay_in_equal_temperament():
    part = WHITE_KEYS.replace("12\n0\n127\n", "12\n48\n72\n", 1)
    found = frequencies_of_keys(read_scale(MEANTONE), read_keyboard_map(part), 440.0)
    assert found[47] == note_frequency(47) and found[73] == note_frequency(73) and found[61 - 1] != note_frequency(60)
    assert 61 not in found and found[69] == pytest.approx(432.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "ends before the number of tones"),
        ("name\n3\n100.\n200.\n", "line 4: it ends after 2 of 3 tones"),
        ("name\n2\n100.0\nabc\n", 'line 4: "abc" is no tone'),
        ("name\n2\n100,5\n200.0\n", 'line 3: "100,5" is no tone'),
        ("name\n! c\n2\n3/0\n2/1\n", 'line 4: "3/0" is no tone'),
        ("name\n2\n-3/2\n2/1\n", 'line 3: "-3/2" is no tone'),
        ("name\n2\n1e400\n2/1\n", 'line 3: "1e400" is no tone'),
        ("name\n0\n", 'line 2: "0" is not the number of tones; give 1 to 4096'),
        ("name\ntwo\n", 'line 2: "two" is not the number of tones'),
        ("name\n1\n99999999.0\n", "is no tone"),
    ],
)
def test_a_bad_scale_is_refused_with_its_line(text, message):
    with pytest.raises(ScalaError, match=message):
        read_scale(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "ends before the size"),
        ("12\n0\n127\n", "ends before the middle key"),
        ("a\n0\n127\n60\n69\n440.0\n12\n", 'line 1: "a" is not the size of the map'),
        ("12\n0\n128\n60\n69\n440.0\n12\n", 'line 3: "128" is not the last key; give 0 to 127'),
        ("12\n0\n127\n60\n69\n-440.0\n12\n", 'line 6: "-440.0" is no frequency'),
        ("12\n0\n127\n60\n69\nnan\n12\n", 'line 6: "nan" is no frequency'),
        ("2\n0\n127\n60\n69\n440.0\n12\n0\nq\n", 'line 9: "q" is no degree'),
        ("0\n90\n10\n60\n69\n440.0\n12\n", "its last key 10 lies below its first one, 90"),
    ],
)
def test_a_bad_map_is_refused_with_its_line(text, message):
    with pytest.raises(ScalaError, match=message):
        read_keyboard_map(text)


# --- instruments


def pitches(scene: engine.Scene, keys: list[int]) -> dict[str, float]:
    """The lowest mode of each string or bar of some keys, rad/s, by its name."""
    found = {}
    for body in live_scene(scene, keys).body:
        of_key = any(body.name.startswith(f"{plain_note_name(key)}_") for key in keys)
        if of_key and body.kind in ("string", "bar", "oscillator"):
            found[body.name] = body.modal_body(20_000.0).omega[0]
    return found


@pytest.mark.filterwarnings("ignore::engine.faults.PatchWarning")
@pytest.mark.parametrize("name", ["meantone", "werckmeister", "slendro"])
@pytest.mark.parametrize("path", INSTRUMENTS, ids=lambda path: path.stem)
def test_every_instrument_follows_a_tuning(tmp_path, path, name):
    """The pitch of what each key plays moves by as many cents as the file says, within 0.1 cent; drums, which have
    pitches of their own, stay."""
    scene, keyboard_map = engine.load(path), FIVE_KEYS if name == "slendro" else None
    wanted = frequencies_of_keys(
        read_scale(SCALES[name]),
        read_keyboard_map(keyboard_map) if keyboard_map else map_from_middle_c(440.0),
        440.0,
    )
    tuned = scene.with_tuning(
        saved(tmp_path, "a.scl", SCALES[name]), saved(tmp_path, "a.kbm", keyboard_map) if keyboard_map else None
    )
    keys = keys_of(tuned.instrument["keyboard"])
    keys = keys[:: max(1, len(keys) // 5)]
    before, after = pitches(scene, keys), pitches(tuned, keys)
    moved = [name for name in before if name.partition("_")[2] not in ("hammer", "mallet", "hand", "shaft", "stick")]
    for body in moved if path.stem not in DRUMS else []:
        key = next(key for key in keys if body.startswith(f"{plain_note_name(key)}_"))
        assert cents(after[body] / before[body], wanted[key] / note_frequency(key)) < 0.1, body
    assert path.stem in DRUMS or path.stem == "guitar_slide" or moved


@pytest.mark.parametrize("name", SCALES)
def test_every_key_sounds_at_the_frequency_of_the_file(tmp_path, name):
    """Within 0.1 cent, on all keys: the rendered sound of an oscillator, by the phase that it has gone through."""
    scene = engine.load(OSCILLATORS).with_tuning(saved(tmp_path, "a.scl", SCALES[name]))
    wanted = frequencies_of_keys(read_scale(SCALES[name]), map_from_middle_c(440.0), 440.0)
    keys = [key for key in keys_of(scene.instrument["keyboard"]) if 40.0 < wanted[key] < 4000.0]
    assert len(keys) > 20
    for key in keys:
        one = engine.load(scene.instrument | {"note": [{"time": 0.0, "key": note_name(key)}], "seconds": 1.0})
        audio = engine.render(one).audio[2000:, 0]
        assert cents(measured(audio), wanted[key]) < 0.1


def measured(audio: np.ndarray, samplerate: int = 44_100) -> float:
    """The frequency of a tone that decays, Hz: x[n + 1] + d²·x[n - 1] = 2·d·cos(ω)·x[n], by least squares."""
    middle, sides = audio[1:-1], np.column_stack([audio[2:], audio[:-2]])
    a, b = np.linalg.lstsq(np.column_stack([middle, -sides[:, 1]]), sides[:, 0], rcond=None)[0]
    return math.acos(a / (2.0 * math.sqrt(b))) / (2.0 * math.pi) * samplerate


def test_keys_that_a_map_leaves_out_are_silent_and_said(tmp_path):
    keyboard_map = saved(tmp_path, "white.kbm", WHITE_KEYS)
    with pytest.warns(PatchWarning, match=r"the tuning leaves out C#3, D#3, .* which are silent"):
        scene = engine.load(OSCILLATORS).with_tuning(saved(tmp_path, "a.scl", MEANTONE), keyboard_map)
    assert [body.name for body in scene.body] == ["C4_bar"]  # the note of C#4 is left out
    file = tmp_path / "a.mid"
    file.write_bytes(smf(track((0, on(60)), (0, on(61)), (480, off(60)), (0, off(61)))))
    played = scene_of_file(scene, file)
    assert played.refused == ["C#4"] and [note.key for note in played.score.notes] == [60]


def test_a_patch_names_its_tuning_and_is_saved_with_its_frequencies(tmp_path):
    saved(tmp_path, "a.scl", MEANTONE)
    patch = OSCILLATORS | {"keyboard": OSCILLATORS["keyboard"] | {"tuning": "a.scl"}}
    (tmp_path / "p.json").write_text(json.dumps(patch))
    scene = engine.load(tmp_path / "p.json")
    wanted = frequencies_of_keys(read_scale(MEANTONE), map_from_middle_c(440.0), 440.0)
    assert scene.body[1].frequency == wanted[61]
    scene.save(tmp_path / "elsewhere.toml")
    (tmp_path / "a.scl").unlink()
    again = engine.load(tmp_path / "elsewhere.toml")
    assert [body.frequency for body in again.body] == [body.frequency for body in scene.body]


@pytest.mark.parametrize(
    ("keyboard", "message"),
    [
        ({"tuning": "none.scl"}, "keyboard.tuning: no such file: .*none.scl; give a scale, .scl"),
        ({"tuning": "bad.scl"}, 'keyboard.tuning: "bad.scl" is not a scale, .scl: line 3: "abc" is no tone'),
        ({"keyboard_map": "bad.scl"}, 'keyboard.keyboard_map: "bad.scl" is not a keyboard map, .kbm: line 1'),
        ({"tuning": "few.scl", "keyboard_map": "white.kbm"}, "the map has degree 12; the scale has 2"),
        ({"tuning": "few.scl", "frequencies": {"C4": 262.0}}, "tuning and frequencies are both given"),
        ({"frequencies": {"H4": 262.0}}, '"H4" is not a key'),
        ({"frequencies": {"C9": 262.0}}, "no key has a frequency"),
        ({"tuning": ""}, "keyboard.tuning"),
        ({"tuning": 7}, "keyboard.tuning"),
    ],
)
def test_a_tuning_that_cannot_be_used_is_refused(tmp_path, keyboard, message):
    saved(tmp_path, "bad.scl", "name\n1\nabc\n")
    saved(tmp_path, "few.scl", "name\n2\n3/2\n2/1\n")
    saved(tmp_path, "white.kbm", WHITE_KEYS)
    patch = OSCILLATORS | {"keyboard": OSCILLATORS["keyboard"] | keyboard}
    (tmp_path / "p.json").write_text(json.dumps(patch))
    with pytest.raises(PatchError, match=message):
        engine.load(tmp_path / "p.json")


def test_the_parts_of_a_rig_are_tuned(tmp_path):
    (tmp_path / "bars.json").write_text(json.dumps(OSCILLATORS))
    (tmp_path / "rig.toml").write_text('[[part]]\npatch = "bars.json"\n[[part]]\npatch = "bars.json"\n')
    scene = engine.load(tmp_path / "rig.toml").with_tuning(saved(tmp_path, "a.scl", MEANTONE))
    wanted = frequencies_of_keys(read_scale(MEANTONE), map_from_middle_c(440.0), 440.0)
    assert [body.frequency for body in scene.body] == [wanted[60], wanted[61]] * 2 and scene.rig is not None


def test_options_give_any_instrument_a_tuning(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, "a.scl", MEANTONE)
    saved(tmp_path, "white.kbm", WHITE_KEYS)
    words = ["vibraphone", "--key", "A4", "--seconds", "0.2", "--kernel", "general", "-o"]
    assert main([*words, "tuned.wav", "--tuning", "a.scl", "--keyboard-map", "white.kbm"]) == 0
    assert "the tuning leaves out" in capsys.readouterr().err
    assert main([*words, "plain.wav"]) == 0
    assert (tmp_path / "tuned.wav").read_bytes() != (tmp_path / "plain.wav").read_bytes()
    capsys.readouterr()
    assert main([*words, "none.wav", "--tuning", "b.scl"]) == 2
    assert "--tuning: no such file: b.scl" in capsys.readouterr().err
    assert main(["tanpura", "--tuning", "a.scl"]) == 2
    assert "the patch has no keys to tune" in capsys.readouterr().err
    assert main(["vibraphone", "--key", "C#4", "--tuning", "a.scl", "--keyboard-map", "white.kbm"]) == 2
    assert "has no key C#4" in capsys.readouterr().err
