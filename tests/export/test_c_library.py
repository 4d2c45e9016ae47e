"""A patch in C: its samples are those of the engine, with nothing but a C compiler and the C library."""

import math
import random
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import soundfile

import engine
from engine.cli.main import main
from engine.compiler.targets import fitting_targets, target_named
from engine.export.c_library import export_c
from engine.export.faults import CannotExport
from engine.export.row_recorder import player_of_scene, sliders_of_player
from engine.export.scene_bytes import SceneBytes
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.patch.tremolo import Tremolo
from tests.compiler.test_shipped import skip_if_stale
from tests.export.tuned_scene import STOPPED_STRING, tuned_as_it_sounds

COMPILER = shutil.which("gcc")
ARM_COMPILER, EMULATOR = shutil.which("aarch64-linux-gnu-gcc"), shutil.which("qemu-aarch64")
WINDOWS_COMPILER = shutil.which("x86_64-w64-mingw32-gcc")
WINE = next(filter(None, map(shutil.which, ("wine64", "/usr/lib/wine/wine64", "wine"))), None)
DRIVER, ROOT = Path(__file__).with_name("driver.c"), Path(__file__).parents[2]
SECONDS = 0.2
PATCHES = ["repelled_oscillator", "piano_c4"]
INSTRUMENTS = ["marimba_keys", "guitar"]
DONE, UNKNOWN, OUT_OF_RANGE, FULL = 0, -1, -2, -3  # as in fdh.h
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no gcc")


class Library:
    """A patch in C, compiled once: its example, and a program that plays it by a script."""

    def __init__(self, scene, folder, compiler=(COMPILER,), runner=(), suffix="", **options):
        skip_if_stale()
        self.scene, self.folder, self.runner, self.suffix = scene, folder, runner, suffix
        export_c(scene, folder, seconds=SECONDS, **options)
        flags = ["-O2", "-std=gnu99", "-Wall", "-Wextra", "-Werror", f"-I{folder}"]
        for main_file in (folder / "main.c", DRIVER):
            sources = [main_file, folder / "fdh.c", *sorted(folder.glob("fdh_*.o"))]
            subprocess.run([*compiler, *flags, "-o", folder / main_file.stem, *sources, "-lm"], check=True)

    def example(self, *words):
        """Return what the example writes, [frames, channels], and the energy error it says."""
        ran = subprocess.run(
            [*self.runner, self.folder / f"main{self.suffix}", *words], check=True, capture_output=True
        )
        return np.frombuffer(ran.stdout).reshape(-1, self.scene.channels), float(ran.stderr.split()[-1])

    def play(self, *lines):
        """Return what instances play by lines of the driver, [frames, channels], and what each call returned."""
        script = "\n".join(" ".join([*line.split(), "0", "0"][:4]) for line in lines)
        program = [*self.runner, self.folder / f"driver{self.suffix}"]
        ran = subprocess.run(program, input=script.encode(), check=True, capture_output=True)
        return np.frombuffer(ran.stdout).reshape(-1, self.scene.channels), [int(word) for word in ran.stderr.split()]


def played(player, frames):
    """Return the next samples of a player before its gain, [frames, channels]."""
    blocks, room = [], np.zeros((128, player.channels), np.float32)
    for begin in range(0, frames, 128):
        count = min(128, frames - begin)
        player.render_into(room[:count])
        blocks.append(player.memory.shared.audio[:count].copy())
    return np.concatenate(blocks)


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize("name", [*PATCHES, "marimba", *INSTRUMENTS])
def test_the_samples_in_c_are_those_of_the_engine(name, library):
    audio, error = library(name).example()
    np.testing.assert_array_equal(audio, engine.render(engine.load(name), seconds=SECONDS, cores=1).audio)
    assert error < 1e-12


@pytest.mark.hard
@needs_compiler
def test_steps_chosen_by_error_are_as_many_as_in_a_rendering(tmp_path):
    """Live sound has 64 for a sample at most; a library has as many as the patch allows."""
    scene = engine.load("barrier_linear")
    scene = scene.model_copy(update={"accuracy": scene.accuracy.replace(max_error=1e-12)})
    audio, _ = Library(scene, tmp_path).example()
    np.testing.assert_array_equal(audio, engine.render(scene, seconds=SECONDS, cores=1).audio)


@pytest.mark.hard
@needs_compiler
def test_a_hammer_in_c_strikes_as_in_live_sound(library):
    """While it sounds, with a stiffer felt, and after a reset."""
    player = Player(engine.load("piano_c4"), seconds=math.inf, kernel="general")
    player.strike("hammer", 3.3)
    first = played(player, 1000)
    player.strike("hammer", 1.7)
    player.set("contact.felt.stiffness", 9e9)
    expected = np.concatenate([first, played(player, 5000)])
    script = ["0 strike 0 3.3", "0 play 1000", "0 strike 0 1.7", "0 set 0 9e9", "0 play 5000"]
    audio, results = library("piano_c4").play(*script, "0 reset", *script)
    assert set(results) == {DONE}
    np.testing.assert_array_equal(audio[:6000], expected)
    np.testing.assert_array_equal(audio[6000:], expected)
    assert np.abs(expected[1000:]).max() > 1e-6


@pytest.mark.hard
@needs_compiler
def test_a_pluck_in_c_is_that_of_live_sound(library):
    player = Player(engine.load("guitar_frets"), seconds=math.inf, kernel="general")
    first = played(player, 3000)
    player.pluck(player.plucked[-1], 0.7)
    pad = len(player.strikers) + len(player.plucked) - 1
    audio, results = library("guitar_frets").play("0 play 3000", f"0 strike {pad} 0.7", "0 play 3000")
    assert set(results) == {DONE}
    np.testing.assert_array_equal(audio, np.concatenate([first, played(player, 3000)]))


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize("name", ["piano_c4", "snare_wires", "guitar_frets", "bowed_violin"])
def test_a_slider_in_c_sets_what_live_sound_sets(name, library):
    """Any value, to the last bit, though contacts amplify each rounding; a height of frets, and a bow, too."""
    rng, scene = random.Random(name), engine.load(name)
    player = Player(scene, seconds=math.inf, kernel="general")
    sliders = sliders_of_player(player_of_scene(scene, 44_100, "general"))
    lines, expected = list[str](), list[np.ndarray]()
    for _ in range(12):
        number = rng.randrange(len(sliders))
        slider = sliders[number]
        nearby = (max(slider.low, 0.5 * slider.value), min(slider.high, 2.0 * slider.value))
        value = rng.uniform(*(nearby if slider.value > 0.0 else (slider.low, slider.high)))
        player.set(slider.path, value)
        lines += [f"0 set {number} {value!r}", "0 play 700"]
        expected.append(played(player, 700))
    audio, results = library(name).play(*lines)
    assert set(results) == {DONE} and np.abs(audio).max() > 0.0
    np.testing.assert_array_equal(audio, np.concatenate(expected))


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize("first", [1, 63, 129, 505])
@pytest.mark.parametrize("name", INSTRUMENTS)
def test_the_first_key_in_c_may_come_at_any_frame(name, first, library):
    player = Player(live_scene(engine.load(name)), 44_100, math.inf, waiting=True, kernel="general")
    keys = KeyAllocator(player)
    silent = played(player, first)
    keys.play(Note(0.0, "on", 60, 64))
    expected = np.concatenate([silent, played(player, 3000)])
    audio, results = library(name).play("0 skip", f"0 play {first}", "0 on 60 64", "0 play 3000")
    assert set(results) == {DONE} and np.abs(audio).max() > 0.0
    np.testing.assert_array_equal(audio, expected)


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize("name", INSTRUMENTS)
def test_the_keys_and_the_pedal_in_c_do_what_those_of_live_sound_do(name, library):
    player = Player(live_scene(engine.load(name)), 44_100, math.inf, waiting=True, kernel="general")
    keys, lines, expected = KeyAllocator(player), ["0 skip"], []
    low, high = keys.keys[3], keys.keys[9]
    moves = [("on", low, 80), ("on", high, 127), ("off", low, 64), ("sustain", 0, 127), ("on", low, 1)]
    moves += [("off", high, 64), ("off", low, 64), ("sustain", 0, 0)]
    for kind, number, value in moves:
        keys.play(Note(0.0, kind, number, value))
        lines += [f"0 pedal {value}" if kind == "sustain" else f"0 {kind} {number} {value}", "0 play 1100"]
        expected.append(played(player, 1100))
    audio, results = library(name).play(*lines)
    assert set(results) == {DONE}
    np.testing.assert_array_equal(audio, np.concatenate(expected))
    assert np.abs(audio).max() > 1e-6


@pytest.mark.hard
@needs_compiler
def test_keys_sound_beside_the_score(library):
    marimba = library("marimba_keys")
    score = marimba.play("0 play 2000")[0]
    keys = marimba.play("0 skip", "0 on 60 64", "0 play 2000")[0]
    both = marimba.play("0 on 60 64", "0 play 2000")[0]
    np.testing.assert_array_equal(both, score + keys)
    assert np.abs(keys).max() > 1e-6


@pytest.mark.hard
@needs_compiler
def test_one_key_more_than_can_sound_ends_the_oldest(library):
    guitar = engine.load("guitar")
    player = Player(live_scene(guitar), 44_100, math.inf, waiting=True, kernel="general")
    keys, lines, expected = KeyAllocator(player), ["0 skip"], []
    for key in keys.keys[:30]:
        keys.play(Note(0.0, "on", key, 64))
        lines += [f"0 on {key} 64", "0 play 100"]
        expected.append(played(player, 100))
    assert keys.stolen or guitar.instrument["keyboard"].get("mono")
    np.testing.assert_array_equal(library("guitar").play(*lines)[0], np.concatenate(expected))


@pytest.mark.hard
@needs_compiler
def test_two_instances_sound_each_by_itself(library):
    piano = library("piano_c4")
    struck = piano.play("0 strike 0 2", "0 play 1000")[0]
    as_written = piano.play("0 play 1000")[0]
    both = piano.play("0 strike 0 2", "0 play 300", "1 play 500", "0 play 700", "1 play 500")[0]
    np.testing.assert_array_equal(np.concatenate([both[:300], both[800:1500]]), struck)
    np.testing.assert_array_equal(np.concatenate([both[300:800], both[1500:]]), as_written)
    assert np.any(struck != as_written)


@pytest.mark.hard
@needs_compiler
def test_what_the_patch_does_not_have_is_refused_and_changes_nothing(library):
    piano, marimba = library("piano_c4"), library("marimba_keys")
    for one, lines in (
        (
            piano,
            {"strike 1 1": UNKNOWN, "strike -1 1": UNKNOWN, "strike 0 nan": OUT_OF_RANGE, "strike 0 1e5": OUT_OF_RANGE},
        ),
        (piano, {"set 99 1": UNKNOWN, "set 0 1": OUT_OF_RANGE, "set 0 inf": OUT_OF_RANGE}),
        (piano, {"on 60 64": UNKNOWN, "off 60": UNKNOWN, "pedal 1": UNKNOWN, "skip": UNKNOWN}),
        (marimba, {"on 0 64": UNKNOWN, "on 60 0": OUT_OF_RANGE, "on 60 128": OUT_OF_RANGE, "off 127": UNKNOWN}),
        (marimba, {"strike 0 1": UNKNOWN, "off 60": DONE}),
    ):
        audio, results = one.play(*(f"0 {line}" for line in lines), "0 play 1000")
        assert results[:-1] == list(lines.values())
        np.testing.assert_array_equal(audio, one.play("0 play 1000")[0])


@pytest.mark.hard
@needs_compiler
def test_events_that_wait_for_no_sound_are_refused_at_some_time(library):
    audio, results = library("piano_c4").play(*["0 strike 0 1"] * 1025, "0 play 100", "0 strike 0 1", "0 play 100")
    assert results == [DONE] * 1024 + [FULL, DONE, DONE, DONE]
    assert np.isfinite(audio).all()


@pytest.mark.hard
@needs_compiler
@pytest.mark.parametrize(
    ("name", "event", "calls"),
    [("marimba_keys", "NOTE", ("on {key} 64", "off {key}")), ("snare_wires", "STROKE", ("strike 0 1",)),
     ("snare_wires", "SETTING", ("set 0 {low}",))],
)  # fmt: skip
def test_as_many_calls_have_room_as_the_header_says(library, name, event, calls):
    one = library(name)
    given = dict(re.findall(r"#define FDH_(\w+) (\S+)", (one.folder / "fdh_patch.h").read_text("utf-8")))
    low = re.search(r"FDH_SLIDER_\w+ 0 /\* .*?(\S+) to", (one.folder / "fdh_patch.h").read_text("utf-8"))
    count = int(given["QUEUE"]) // int(given[f"EVENTS_OF_{event}"])
    key = given["MIDDLE_KEY"]
    lines = [f"0 {call.format(key=key, low=low and low[1])}" for call in calls] * count
    _, results = one.play(*lines, "0 play 10")
    assert results == [DONE] * (len(lines) + 1) and count > 30


@pytest.mark.hard
@needs_compiler
def test_the_example_refuses_what_it_cannot_do(library, tmp_path):
    one = library("piano_c4")
    for words in (["foo"], ["-5"], ["12x"], [""], ["1", "2"], [str(tmp_path / "x.wave")]):
        done = subprocess.run([one.folder / "main", *words], capture_output=True)
        assert done.returncode == 1 and not done.stdout and b"give nothing, a number" in done.stderr, words


@pytest.mark.hard
@needs_compiler
def test_the_example_writes_a_struck_note(library):
    for name in ("piano_c4", "marimba_keys"):
        one = library(name)
        file = one.folder / "struck.wav"
        one.example(str(file))
        audio, rate = soundfile.read(file, always_2d=True)
        assert (rate, audio.shape) == (44_100, (3 * 44_100, one.scene.channels))
        given = dict(re.findall(r"#define FDH_(\w+) (\S+)", (one.folder / "fdh_patch.h").read_text("utf-8")))
        assert float(given["GAIN"]) == one.scene.level_factor
        struck = (
            ["skip", f"on {given['MIDDLE_KEY']} 90"] if given["KEYS"] != "0" else [f"strike 0 {given['FIRST_SIZE']}"]
        )
        heard, _ = one.play(*(f"0 {line}" for line in struck), f"0 play {len(audio)}")
        assert np.abs(audio).max() > 0.01
        np.testing.assert_allclose(audio, one.scene.level_factor * heard, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(None in (ARM_COMPILER, EMULATOR), reason="Debian: gcc-aarch64-linux-gnu, qemu-user")
@pytest.mark.parametrize("name", PATCHES)
def test_another_processor_computes_the_same_samples(name, tmp_path):
    """An emulator of 64-bit ARM, whose C library is another build."""
    scene = engine.load(name)
    arm = Library(scene, tmp_path, [ARM_COMPILER, "-static"], [EMULATOR], target="aarch64-linux")
    audio, error = arm.example()
    np.testing.assert_array_equal(audio, engine.render(scene, seconds=SECONDS, cores=1).audio)
    assert error < 1e-12


@pytest.mark.slow
@pytest.mark.skipif(None in (WINDOWS_COMPILER, WINE), reason="Debian: gcc-mingw-w64-x86-64-posix, wine64")
@pytest.mark.parametrize("target", ["windows-x86-64-v3", "windows-x86-64-v4"])
@pytest.mark.parametrize("name", PATCHES)
def test_windows_computes_the_same_samples(name, target, tmp_path):
    """In Wine, with the C library of Windows."""
    if not set(target_named(target).needed) <= {feature for one in fitting_targets() for feature in one.needed}:
        pytest.skip("another processor")
    scene = engine.load(name)
    windows = Library(scene, tmp_path, [WINDOWS_COMPILER, "-static", "-Wno-format"], [WINE], ".exe", target=target)
    audio, error = windows.example()
    np.testing.assert_array_equal(audio, engine.render(scene, seconds=SECONDS, cores=1).audio)
    assert error < 1e-12


def test_each_pointer_of_a_narrow_machine_is_where_its_compiler_looks():
    """Two arrays, nothing and a truth value, for pointers of four bytes and of eight."""
    a, b = np.arange(3.0), np.arange(4).reshape(2, 2)
    for width, places in ((4, (24, 88)), (8, (32, 96))):
        laid_out = SceneBytes(width)
        laid_out.add("value", (a, (None, b), True))
        begin = laid_out.values["value"]
        assert laid_out.pointers[0] == begin + places[0]
        for place, array in zip(laid_out.pointers, (a, b), strict=True):
            at = int.from_bytes(laid_out.content[place : place + width], "little")
            assert at == laid_out.place_of(array)
            np.testing.assert_array_equal(np.frombuffer(laid_out.content, array.dtype, array.size, at), array.ravel())


def test_what_cannot_be_exported_is_said_before_anything_is_made(tmp_path):
    scene = engine.load("barrier_linear")
    coarse = scene.model_copy(update={"accuracy": scene.accuracy.replace(oversample=2)})
    with pytest.raises(CannotExport, match="oversample"):
        export_c(coarse, tmp_path / "c")
    with pytest.raises(CannotExport, match="tremolo"):
        export_c(scene.model_copy(update={"tremolo": Tremolo(rate=5.0)}), tmp_path / "c")
    for changed in (tuned_as_it_sounds("piano_c4", "string"), engine.load(STOPPED_STRING)):
        with pytest.raises(CannotExport, match="change bodies cannot be exported to C"):
            export_c(changed, tmp_path / "c")
    with pytest.raises(ValueError, match="no target is called 'vax'; there are x86_64-linux"):
        export_c(scene, tmp_path / "c", "vax")
    assert not (tmp_path / "c").exists()


def test_bad_options_of_the_command_are_said_at_once(tmp_path, capsys):
    assert main(["export", "barrier_linear", "--c", str(tmp_path / "none" / "c"), "--target", "vax"]) == 2
    said = capsys.readouterr().err
    assert "the folder that it would be in is not there" in said and "no target is called 'vax'" in said
