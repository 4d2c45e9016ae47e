"""A plug-in has the samples of live sound, at any block size, whatever is played; and it does what hosts expect."""

import math
import random
import shutil
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import mostly_hard

import engine
from engine.assembly.build import BuildError
from engine.export.faults import CannotExport
from engine.export.plugin_data import MAGIC, PluginSettings, make_plugin_data
from engine.export.row_recorder import LEVELS
from engine.files import shipped_names
from tests.export.clap_host import (
    CHOKE,
    NOTE_OFF,
    NOTE_ON,
    PARAM_MOD,
    SLEEP,
    ClapLibrary,
    midi,
    note,
    parameter,
)
from tests.export.key_messages import RATE, TWO_TINES
from tests.export.plugins import events_of, is_same, needs_linker, play_live, write_plugin
from tests.live.two_ways import KINDS, Message, draw_messages

pytestmark = needs_linker
FRAMES = 20_000
PIANO_MEGABYTES, VIBRAPHONE_MEGABYTES, SECOND_PIANO_MEGABYTES = 70.0, 0.3, 20.0
BLOCKS = [(1,), (17, 64, 256), (4096,), (255,)]


def at_levels(messages):
    """Messages with the nearest velocities that are recorded."""
    return [
        m._replace(value=min(LEVELS, key=lambda one: abs(one - m.value))) if m.kind == "on" else m for m in messages
    ]


@pytest.fixture(scope="module")
def tines(tmp_path_factory):
    """An instrument of five keys of which two sound, as a scene and a plug-in."""
    scene = engine.load(TWO_TINES)
    return scene, write_plugin(scene, tmp_path_factory.mktemp("tines"))


# --- the same samples


STRUCK = [
    ("tines", 62),
    ("vibraphone", 65),
    ("guitar", 52),
    ("violin", 69),
    ("kalimba_keys", 69),
    ("piano", 60),
    ("toms", 41),
]
CASES = [(name, kind) for name in ("tines", "vibraphone", "violin", "guitar", "kalimba_keys") for kind in KINDS]


@pytest.mark.parametrize(("name", "kind"), mostly_hard(CASES, CASES[0], CASES[4], CASES[6]))
def test_keys_sound_as_in_live_sound(name, kind, tmp_path):
    """At all frames, in blocks of any size, and again after a reset."""
    scene = engine.load(TWO_TINES if name == "tines" else name)
    plugin = write_plugin(scene, tmp_path)
    messages = at_levels(draw_messages(scene, kind, 1, FRAMES))
    expected = play_live(scene, RATE, plugin.gain, messages, FRAMES)
    instance = plugin.active()
    for blocks in BLOCKS:
        for events in (events_of(messages), events_of(messages, as_midi=True)):
            assert is_same(instance.render(FRAMES, events, blocks), expected)
            instance.reset()


@pytest.mark.hard
@pytest.mark.parametrize("rate", [44_100, 48_000, 96_000])
def test_each_sample_rate_has_its_own_tables(rate, tmp_path):
    scene = engine.load("marimba_keys")
    plugin = write_plugin(scene, tmp_path, [44_100, 48_000, 96_000])
    messages = at_levels(draw_messages(scene, "overlapping", 2, FRAMES))
    instance = plugin.active(rate)
    assert instance.latency == 0
    assert is_same(instance.render(FRAMES, events_of(messages)), play_live(scene, rate, plugin.gain, messages, FRAMES))


def test_notes_sound_as_in_a_rendering_of_the_same_score(tmp_path):
    """A plug-in that is played, and the same notes as a score, which is rendered."""
    notes = [{"time": n * 0.05, "key": "C4", "duration": 0.03, "velocity": v} for n, v in enumerate((32, 127, 64))]
    document = TWO_TINES | {"note": notes}
    scene = engine.load(TWO_TINES)
    plugin = write_plugin(scene, tmp_path)
    instance = plugin.active()
    events = [
        event
        for one in notes
        for event in (
            note(round(one["time"] * RATE), NOTE_ON, 60, one["velocity"]),
            note(round((one["time"] + one["duration"]) * RATE), NOTE_OFF, 60),
        )
    ]
    rendered = engine.render(engine.load(document), seconds=0.3, cores=1).audio
    assert is_same(instance.render(len(rendered), events), (rendered * plugin.gain).astype(np.float32))


@pytest.mark.hard
def test_the_wheel_bends_strings_as_live_sound_does(tmp_path):
    scene = engine.load("violin")
    plugin = write_plugin(scene, tmp_path)
    messages = [Message(0, "on", 67, 80), Message(3001, "bend", 0, 100), Message(9000, "bend", 0, -200)]
    messages.append(Message(14_007, "bend", 0, 0))
    expected = play_live(scene, RATE, plugin.gain, messages, FRAMES)
    assert is_same(plugin.active().render(FRAMES, events_of(messages)), expected)
    assert "pitch" in plugin.active().parameters()


@pytest.mark.parametrize("name", mostly_hard(["piano_c4", "guitar_frets", "snare_wires"], "piano_c4"))
def test_a_patch_without_keys_has_pads(name, tmp_path):
    """Its hammers and plucks are notes from 36, the harder the faster; and it begins as the patch does."""
    scene = engine.load(name)
    plugin = write_plugin(scene, tmp_path)
    messages = [Message(5000, "on", 36, 96), Message(9001, "on", 36, 64)]
    expected = play_live(scene, RATE, plugin.gain, messages, FRAMES)
    assert is_same(plugin.active().render(FRAMES, events_of(messages)), expected)


@pytest.mark.hard
@pytest.mark.parametrize("name", shipped_names())
def test_every_shipped_patch_is_a_plugin(name, tmp_path):
    scene = engine.load(name)
    try:
        plugin = write_plugin(scene, tmp_path)
    except (CannotExport, BuildError) as error:
        pytest.skip(str(error))
    messages = [Message(0, "on", 60, 64), Message(9000, "off", 60, 64)] if scene.instrument else []
    audio = plugin.active().render(RATE, events_of(messages))
    assert np.count_nonzero(audio != play_live(scene, RATE, plugin.gain, messages, RATE)) == 0


# --- what a host expects


def test_a_parameter_is_automated_at_its_sample(tmp_path):
    """With names, units, and texts both ways; a modulation is added and goes away."""
    scene = engine.load("piano_c4")
    plugin = write_plugin(scene, tmp_path)
    instance = plugin.active()
    stiffness = instance.parameters()["contact.felt.stiffness"]
    at_home = scene.contact[0].stiffness
    assert stiffness.low == 0.0 and stiffness.high == 1.0  # by ratios
    text = instance.text(stiffness.id, stiffness.default)
    assert float(text.split()[0]) == pytest.approx(at_home, rel=1e-5) and len(text.split()) > 1
    place = instance.value_of(stiffness.id, f"{2 * at_home!r} N/m^p")
    assert float(instance.text(stiffness.id, place).split()[0]) == pytest.approx(2 * at_home, rel=1e-5)
    assert instance.value_of(stiffness.id, "soft") is None and instance.value_of(stiffness.id, "-1") is None
    strike = [note(100, NOTE_ON, 36, 64)]
    changed = instance.render(FRAMES, [*strike, parameter(77, stiffness.id, place)])
    assert instance.value(stiffness.id) == place
    messages = [Message(77, "set", "contact.felt.stiffness", 2 * at_home), Message(100, "on", 36, 64)]
    expected = play_live(scene, RATE, plugin.gain, messages, FRAMES)
    np.testing.assert_allclose(changed, expected, rtol=0, atol=2e-6)
    instance.reset()
    back = [parameter(0, stiffness.id, stiffness.default)]
    modulated = [parameter(77, stiffness.id, place - stiffness.default, PARAM_MOD)]
    assert is_same(instance.render(FRAMES, [*back, *strike, *modulated]), changed)
    assert instance.value(stiffness.id) == stiffness.default  # a modulation moves no knob


def test_a_project_that_is_loaded_again_sounds_the_same(tmp_path):
    """Also in a host that loads it before it plays, and one that restores values while it plays."""
    scene = engine.load("piano_c4")
    plugin = write_plugin(scene, tmp_path)
    first = plugin.active()
    stiffness = first.parameters()["contact.felt.stiffness"].id
    first.render(10, [parameter(0, stiffness, 0.7)])
    state = first.save()
    first.reset()
    expected = first.render(FRAMES, [note(50, NOTE_ON, 36, 80)])
    library = plugin.opened()
    other = library.plugin()
    assert other.load(state) and not library.logged
    assert other.activate(RATE) and other.value(stiffness) == pytest.approx(0.7, abs=1e-12)
    audio = other.render(FRAMES, [note(50, NOTE_ON, 36, 80)])
    np.testing.assert_allclose(audio, expected, rtol=0, atol=1e-6)
    unlike = state.replace(b"contact.felt.stiffness", b"contact.other.stiffness").replace(b"fdh 1 ", b"fdh 1 0")
    assert other.load(unlike)
    said = " ".join(text for _, text in library.logged)
    assert "another file" in said and "contact.other.stiffness" in said
    assert not other.load(b"nonsense") and not other.load(b"")


def test_a_choke_ends_a_note_within_ten_milliseconds(tines):
    """60 dB and more; a note that is let go rings on."""
    instance = tines[1].active()
    levels = {}
    for end in (CHOKE, NOTE_OFF):
        instance.reset()
        audio = instance.render(4 * 441 + 441, [note(0, NOTE_ON, 60, 127), note(882, end, 60)])
        levels[end] = np.abs(audio[882 + 441 :]).max() / np.abs(audio[:882]).max()
    assert levels[CHOKE] < 1e-3 < levels[NOTE_OFF]


def test_a_note_that_has_died_away_is_said(tines):
    """Once, with its number, when it no longer sounds; and the plug-in sleeps then."""
    instance = tines[1].active()
    audio = instance.render(2 * RATE, [note(0, NOTE_ON, 60, 64, 7), note(2000, NOTE_OFF, 60, 64, 7)])
    assert [(key, number) for _, key, number in instance.ended] == [(60, 7)]
    frame = instance.ended[0][0]
    assert frame > 2000 and not audio[frame + 1 :].any()
    assert instance.answers[-1] == SLEEP


def test_all_notes_end_by_messages_of_midi(tines):
    """120 ends sounds, 123 lets keys go, 121 lifts the pedals."""
    instance = tines[1].active()
    held = [midi(0, 0x90, 60, 100), midi(10, 0xB0, 64, 127), midi(20, 0x90, 64, 100)]
    ended = instance.render(6000, [*held, midi(2000, 0xB0, 120, 0)])
    assert np.abs(ended[3000:]).max() < 1e-3 * np.abs(ended[:2000]).max()
    instance.reset()
    pedalled = instance.render(40_000, [*held, midi(2000, 0xB0, 123, 0), midi(20_000, 0xB0, 121, 0)])
    kept, after = np.abs(pedalled[2500:20_000]).max(), np.abs(pedalled[30_000:]).max()
    assert kept > 0.1 * np.abs(pedalled[:2000]).max() and after < 1e-3 * kept


def test_no_note_hangs_in_a_storm(tines):
    """20 000 events within a second, many at one sample; then all keys come up, and it is silent."""
    rng, events = random.Random(3), []
    for _ in range(20_000):
        frame, key = rng.randrange(0, 44_100 // 64) * 64, rng.randrange(60, 68)
        kind = rng.randrange(5)
        if kind < 4:
            events.append(note(frame, NOTE_ON if kind < 2 else NOTE_OFF, key, rng.randrange(1, 128)))
        else:
            events.append(midi(frame, 0xB0, rng.choice((64, 66, 67)), rng.randrange(128)))
    last = [midi(44_200, 0xB0, pedal, 0) for pedal in (64, 66, 67)] + [midi(44_300, 0xB0, 123, 0)]
    instance = tines[1].active()
    audio = instance.render(4 * RATE, [*events, *last], (64, 512))
    assert np.isfinite(audio).all() and np.abs(audio).max() <= 1.0
    assert not audio[-RATE // 2 :].any() and instance.answers[-1] == SLEEP
    instance.reset()
    assert is_same(
        instance.render(FRAMES, events_of(tines_song())), play_live(tines[0], RATE, tines[1].gain, tines_song(), FRAMES)
    )


def test_what_finds_no_room_is_counted_and_no_release_is_among_it(tmp_path):
    """Thousands of events at one sample: the queue is full, notes are lost and said; the keys come up all the same."""
    scene = engine.load("guitar")
    plugin = write_plugin(scene, tmp_path)
    instance = plugin.active()
    keys = list(range(45, 60))
    storm = [note(100, NOTE_ON if n % 2 else NOTE_OFF, key, 64) for n in range(200) for key in keys]
    storm += [note(100, NOTE_OFF, key) for key in keys for _ in range(200)]
    audio = instance.render(8 * RATE, [*storm, midi(101, 0xB0, 123, 0), midi(RATE, 0xB0, 120, 0)])
    lost = instance.parameters()["lost events"]
    assert instance.value(lost.id) > 0 and "events lost" in instance.text(lost.id, instance.value(lost.id))
    assert np.abs(audio[-RATE:]).max() < 1e-4 * np.abs(audio).max()


def tines_song():
    """A few notes."""
    return [
        Message(0, "on", 60, 64),
        Message(700, "on", 64, 127),
        Message(5000, "off", 60, 64),
        Message(9000, "off", 64, 64),
    ]


def test_instances_in_threads_do_not_disturb_each_other(tines):
    scene, plugin = tines
    expected, library, sounds = play_live(scene, RATE, plugin.gain, tines_song(), FRAMES), plugin.opened(), {}

    def play(number):
        for _ in range(3):
            instance = library.plugin()
            assert instance.activate(RATE)
            sounds[number] = instance.render(FRAMES, events_of(tines_song()), (64,))
            instance.deactivate()
            instance.destroy()

    threads = [threading.Thread(target=play, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(sounds) == 4 and all(is_same(audio, expected) for audio in sounds.values())


@pytest.mark.parametrize("rate", [22_050, 88_200, 192_000])
def test_another_sample_rate_is_resampled(rate, tines):
    """The same sound: band by band as at the rate that is there, but for the delay that it says."""
    scene, plugin = tines
    library = plugin.opened()
    instance = library.plugin()
    assert instance.activate(rate) and 0 < instance.latency < 0.005 * rate
    assert any("resampled" in text for _, text in library.logged)
    messages = [Message(0, "on", 60, 127)]
    audio = instance.render(rate + instance.latency, events_of(messages), (1, 100, 333))[:, 0]
    expected, window = play_live(scene, RATE, plugin.gain, messages, RATE)[:, 0], np.hanning
    audio = audio[instance.latency :]
    seconds = len(audio) / rate
    expected = expected[: round(seconds * RATE)]
    ours, theirs = (np.abs(np.fft.rfft(x * window(len(x)))) / len(x) for x in (audio, expected))
    band = slice(50, 5000)  # Hz: both last a second
    error = np.linalg.norm(ours[band] - theirs[band]) / np.linalg.norm(theirs[band])
    assert error < 2e-3
    assert ours[int(0.49 * min(rate, RATE)) :].max() < 1e-5 * ours.max()


@pytest.mark.parametrize(("name", "key"), mostly_hard(STRUCK, STRUCK[0]))
def test_between_the_recorded_velocities_the_level_is_near(name, key, tmp_path):
    """Within 0.5 dB of live sound, from the softest on; of a bowed note over a second, as the order of its first slips
    depends on the last digits of the bow's force."""
    scene = engine.load(TWO_TINES if name == "tines" else name)
    plugin, frames = write_plugin(scene, tmp_path), RATE if name == "violin" else 8000
    instance, off = plugin.active(), []
    for velocity in (*range(2, 20, 3), *range(20, 127, 13)):
        instance.reset()
        messages = [Message(0, "on", key, velocity)]
        ours = instance.render(frames, events_of(messages))
        off.append(20 * math.log10(np.std(ours) / np.std(play_live(scene, RATE, plugin.gain, messages, frames))))
    assert len(off) > 10 and max(map(abs, off)) < 0.5


# --- files


def test_files_that_cannot_be_played_are_refused_in_a_sentence(tines, tmp_path):
    """Missing, cut, damaged, foreign, of other kernels: the host's log says which; nothing crashes."""
    plugin = tines[1]
    good = bytearray(plugin.data.read_bytes())
    sources = bytearray(good)
    sources[24] ^= 1
    version = bytearray(good)
    version[7] = ord("2")
    damaged = bytearray(good)
    damaged[-100] ^= 4
    cases = {
        "not there": None,
        "no .fdh file": b"RIFF" * 100,
        "cut": good[:-8],
        "other kernels": sources,
        "another version": version,
        "damaged": damaged,
    }
    for number, (says, content) in enumerate(cases.items()):
        path = tmp_path / f"case{number}.clap"
        shutil.copy(plugin.path, path)
        if content is not None:
            path.with_suffix(".fdh").write_bytes(content)
        library = ClapLibrary(path)
        instance = library.plugin()
        assert instance is None or not instance.activate(RATE)
        assert len(library.logged) == 1 and says in library.logged[0][1]
    assert good.startswith(MAGIC)


def test_what_cannot_be_exported_says_why(tmp_path):
    scene = engine.load("bouncing_ball")
    with pytest.raises(CannotExport, match="sample rate"):
        make_plugin_data(scene, PluginSettings("x", lambda: 1.0, [100]))
    with pytest.raises(CannotExport, match="1 to 8 sample rates"):
        make_plugin_data(scene, PluginSettings("x", lambda: 1.0, []))
    with pytest.raises(CannotExport, match="no_such"):
        make_plugin_data(scene, PluginSettings("x", lambda: 1.0, [44_100], ["no_such"]))


@pytest.mark.hard
def test_files_are_small_and_instances_share_what_stays(tmp_path):
    """The sizes that the guide names; a second piano has what it changes for itself, and no more."""
    sizes = {}
    for name, rates in (("vibraphone", (44_100, 48_000, 96_000)), ("piano", (44_100,))):
        plugin = write_plugin(engine.load(name), tmp_path, rates, name=name)
        sizes[name] = plugin.data.stat().st_size / 1e6
    assert sizes["vibraphone"] <= VIBRAPHONE_MEGABYTES and 3 * sizes["piano"] <= PIANO_MEGABYTES
    library = plugin.opened()
    instances = [library.plugin()]
    assert instances[0].activate(44_100)
    before = resident_megabytes()
    instances.append(library.plugin())
    assert instances[1].activate(44_100)
    assert resident_megabytes() - before <= SECOND_PIANO_MEGABYTES


def resident_megabytes():
    """Memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def test_the_standards_own_headers_agree(tmp_path):
    """Sizes and places of all that our short headers declare."""
    clap, lv2 = Path("/usr/share/dpf/distrho/src"), Path("/usr/include/lv2/core/lv2.h")
    if not clap.is_dir() or not lv2.is_file() or shutil.which("gcc") is None:
        pytest.skip("the packages dpf-source and lv2-dev are not there")
    ours = Path(engine.__file__).parent / "export" / "plugin"
    headers = {
        "ours": [f'#include "{ours}/clap_abi.h"', f'#include "{ours}/lv2_abi.h"'],
        "theirs": [
            *(
                f"#include <clap/{name}.h>"
                for name in ("entry", "plugin-factory", "ext/params", "ext/state", "ext/latency")
            ),
            *(f"#include <clap/ext/{name}.h>" for name in ("audio-ports", "note-ports")),
            *(f"#include <lv2/{name}.h>" for name in ("core/lv2", "atom/atom", "urid/urid", "log/log")),
        ],
    }
    kinds = {
        "clap_host_t": "get_extension",
        "clap_event_note_t": "velocity",
        "clap_event_param_value_t": "value",
        "clap_event_midi_t": "data",
        "clap_process_t": "out_events",
        "clap_audio_buffer_t": "constant_mask",
        "clap_plugin_descriptor_t": "features",
        "clap_plugin_t": "on_main_thread",
        "clap_audio_port_info_t": "in_place_pair",
        "clap_note_port_info_t": "name",
        "clap_param_info_t": "default_value",
        "clap_plugin_params_t": "flush",
        "clap_plugin_state_t": "load",
        "clap_plugin_entry_t": "get_factory",
        "clap_plugin_factory_t": "create_plugin",
        "LV2_Descriptor": "extension_data",
        "LV2_Lib_Descriptor": "get_plugin",
        "LV2_Atom_Event": "body",
        "LV2_Atom_Sequence": "atom",
        "LV2_URID_Map": "map",
        "LV2_Log_Log": "vprintf",
    }
    lines = [f'printf("{k} %zu %zu\\n", sizeof({k}), offsetof({k}, {field}));' for k, field in kinds.items()]
    numbers = ["CLAP_EVENT_MIDI", "CLAP_PROCESS_SLEEP", "CLAP_PARAM_IS_MODULATABLE", "CLAP_PARAM_IS_AUTOMATABLE"]
    lines += [f'printf("%d\\n", (int){number});' for number in [*numbers, "CLAP_NAME_SIZE", "CLAP_PATH_SIZE"]]
    said = []
    for name, included in headers.items():
        source = tmp_path / f"{name}.c"
        source.write_text(
            "\n".join(["#include <stddef.h>", "#include <stdio.h>", *included, "int main(void) {", *lines, "}"])
        )
        subprocess.run(["gcc", f"-I{clap}", "-o", tmp_path / name, source], check=True)
        said.append(subprocess.run([tmp_path / name], check=True, capture_output=True, text=True).stdout)
    assert said[0] == said[1] and len(said[0].splitlines()) == len(kinds) + 6
