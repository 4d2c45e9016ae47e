"""Rigs: several instruments that are played together, rendered and live."""

import json
import math
import random
from pathlib import Path

import mido
import numpy as np
import pytest

import engine
from engine.cli.main import main
from engine.faults import PatchError
from engine.instrument.expansion import keys_of
from engine.live.instrument_notes import scene_of_file
from engine.live.key_allocator import live_rig
from engine.live.midi_notes import parse_message
from engine.live.mpe import MpeZones
from engine.live.replay import replay
from engine.live.rig_keys import RigKeys
from engine.patch.control_tables import Midi
from engine.patch.rig import explain_accuracy
from engine.patch.scene import Scene
from tests.live.two_ways import GAIN, RATE, TICKS, WAYS, Way, count_differences, make_player, play_told

KEYS = {
    "keyboard": {"keys": "C2..C7"},
    "key": {
        "body": [{"name": "bar", "kind": "oscillator", "mass": 1e-3, "frequency": "= f", "damping_rate": 4.0}],
        "on": [{"kind": "pluck", "body": "bar", "amplitude": "= v", "duration": 1e-3}],
        "damper": [{"body": "bar", "sigma": 60.0}],
        "pickup": [{"body": "bar"}],
    },
    "level": 0.0,
    "seconds": 1.0,
}
AT_ITS_FRAME = Way("at its frame", 0)


def saved_rig(folder: Path, *parts: str, head: str = "") -> Path:
    """Save a rig, and two instruments of oscillators beside it."""
    (folder / "bars.json").write_text(json.dumps(KEYS))
    high = KEYS | {"keyboard": {"keys": "C4..C8"}, "title": "High"}
    (folder / "high.json").write_text(json.dumps(high))
    path = folder / "rig.toml"
    path.write_text(head + "".join(f"[[part]]\n{part}\n" for part in parts))
    return path


# --- what a rig is


def test_parts_sound_as_they_do_alone(tmp_path):
    """The sum of both at their levels and places, to the rounding of sums."""
    path = saved_rig(tmp_path, 'patch = "bars.json"\nlevel = -6.0\npan = -1.0', 'patch = "high.json"\ntranspose = 12')
    audio = engine.render(engine.load(path), 0.5).audio
    one, other = (engine.render(engine.load(tmp_path / f"{name}.json"), 0.5).audio[:, 0] for name in ("bars", "high"))
    np.testing.assert_allclose(audio[:, 0], 10 ** (-6 / 20) * one + other, atol=1e-12 * np.abs(one).max())
    np.testing.assert_allclose(audio[:, 1], other, atol=1e-12 * np.abs(one).max())


def test_a_rig_names_what_its_parts_have(tmp_path):
    path = saved_rig(tmp_path, 'patch = "bars.json"', 'patch = "bars.json"', 'patch = "high.json"\nname = "top"')
    scene = engine.load(path)
    assert [body.name for body in scene.body] == ["bars__C4_bar", "bars_2__C4_bar", "top__C4_bar"]
    assert [member.name for member in scene.rig.members] == ["bars", "bars_2", "top"]


def test_mute_parts_are_left_out(tmp_path):
    scene = engine.load(saved_rig(tmp_path, 'patch = "bars.json"', 'patch = "high.json"\nmute = true'))
    assert [member.name for member in scene.rig.members] == ["bars"]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (['patch = "none.toml"'], r"rig.toml:2 part\[0\].patch: no such file"),
        (['patch = "bars.json"', 'patch = "tanpura"'], r"rig.toml:4 part\[1\].patch: tanpura has no keys"),
        (
            ['patch = "bars.json"\nkeys = "C-1..E0"'],
            r"rig.toml:3 part\[0\].keys: it has none of these keys; .* C2 to",
        ),
        (['patch = "bars.json"\nkeys = "C7"\ntranspose = 12'], r"none of these keys, \+12 semitones"),
        (['patch = "bars.json"\nkeys = "H2"'], r'rig.toml:3 part\[0\].keys: "H2" is not a key'),
        (['patch = "bars.json"\nchanel = 2'], r'rig.toml:3 part\[0\].chanel: unknown key; did you mean "channel"?'),
        (['patch = "bars.json"\nchannel = 17'], r"rig.toml:3 part\[0\].channel: 17 is out of range"),
        (['patch = "bars.json"\nvelocities = [90, 20]'], "velocities 90 to 20 are none"),
        (['patch = "bars.json"\nname = "a"', 'patch = "high.json"\nname = "a"'], 'two parts are named "a"'),
        (['patch = "bars.json"\nmute = true'], "all parts are mute"),
        (["channel = 1"], r"part\[0\].patch: this key is missing"),
        (['patch = "bars.json"\ntransposition = 1'], 'did you mean "transpose"'),
    ],
)
def test_a_rig_that_cannot_be_played_is_refused_with_its_line(tmp_path, parts, message):
    with pytest.raises(PatchError, match=message):
        engine.load(saved_rig(tmp_path, *parts))


def test_a_patch_with_faults_is_named(tmp_path):
    path = saved_rig(tmp_path, 'patch = "bars.json"', 'patch = "broken.toml"')
    (tmp_path / "broken.toml").write_text("[keyboard]\nkeyz = 1\n")
    with pytest.raises(PatchError, match=r"broken.toml:2 keyboard.keyz: unknown key"):
        engine.load(path)


def test_parts_that_cannot_stand_in_one_scene_are_refused(tmp_path):
    path = saved_rig(tmp_path, 'patch = "bars.json"', 'patch = "heavy.json"')
    (tmp_path / "heavy.json").write_text(json.dumps(KEYS | {"gravity": 9.81}))
    with pytest.raises(PatchError, match=r"the parts differ in gravity \(bars 0, heavy 9.81\)"):
        engine.load(path)
    (tmp_path / "heavy.json").write_text(json.dumps(KEYS | {"accuracy": {"scheme": "fdh"}}))
    with pytest.raises(PatchError, match="the parts differ in scheme or oversample"):
        engine.load(path)
    (tmp_path / "heavy.json").write_text(json.dumps(KEYS | {"accuracy": {"substeps": 3}}))
    assert engine.load(path).accuracy.substeps == 3


# --- what its parts play


def rendered(path: Path, messages: list, seconds: float = 1.0) -> dict[str, list[tuple[int, int]]]:
    """The keys and velocities that each part plays of messages."""
    file, track = mido.MidiFile(ticks_per_beat=480), mido.MidiTrack()
    file.tracks.append(track)
    track += [message.copy(time=60) for message in messages]
    file.save(path.parent / "a.mid")
    scene = scene_of_file(engine.load(path), path.parent / "a.mid").scene
    found: dict[str, list[tuple[int, int]]] = {}
    for event in scene.event:
        if event.kind == "pluck":
            name, _, rest = event.body.partition("__")
            found.setdefault(name, []).append((rest.partition("_")[0], round(127 * event.amplitude)))
    return found


def on(key: int, velocity: int = 64, channel: int = 1) -> mido.Message:
    return mido.Message("note_on", note=key, velocity=velocity, channel=channel - 1)


def off(key: int, channel: int = 1) -> mido.Message:
    return mido.Message("note_off", note=key, channel=channel - 1)


def program(number: int, channel: int = 1) -> mido.Message:
    return mido.Message("program_change", program=number - 1, channel=channel - 1)


def test_keys_channels_velocities_and_transpositions_divide_the_notes(tmp_path):
    path = saved_rig(
        tmp_path,
        'name = "low"\npatch = "bars.json"\nkeys = "C2..B3"\nchannel = 1',
        'name = "top"\npatch = "high.json"\nkeys = "C4..C6"\nchannel = 1\ntranspose = 12',
        'name = "loud"\npatch = "bars.json"\nchannel = 1\nvelocities = [100, 127]',
        'name = "other"\npatch = "bars.json"\nchannel = 2\ncurve = 0.5',
    )
    notes = [on(48, 50), off(48), on(60, 110), off(60), on(62, 32, 2), off(62, 2)]
    soft = round(127 * (32 / 127) ** 0.5)
    wanted = {"low": [("C3", 50)], "top": [("C5", 110)], "loud": [("C4", 110)], "other": [("D4", soft)]}
    assert rendered(path, notes) == wanted


def test_parts_that_overlap_are_layers(tmp_path):
    path = saved_rig(tmp_path, 'name = "a"\npatch = "bars.json"', 'name = "b"\npatch = "high.json"')
    assert rendered(path, [on(60), off(60)]) == {"a": [("C4", 64)], "b": [("C4", 64)]}


def test_program_changes_choose_parts(tmp_path):
    path = saved_rig(
        tmp_path,
        'name = "a"\npatch = "bars.json"\nprogram = 1',
        'name = "b"\npatch = "bars.json"\nprogram = 12',
        'name = "c"\npatch = "bars.json"',
    )
    notes = [on(60), off(60), program(12), on(62), off(62), program(5), on(64), off(64), program(1, 2), on(65), off(65)]
    played = rendered(path, notes)
    assert played["a"] == [("C4", 64)] and played["b"] == [("D4", 64)]
    assert played["c"] == [("C4", 64), ("D4", 64), ("E4", 64), ("F4", 64)]


def test_a_key_that_is_held_ends_though_the_program_changed(tmp_path):
    """A release goes to the part that was pressed."""
    one, other = (f'name = "{name}"\npatch = "bars.json"\nprogram = {n}' for n, name in ((1, "a"), (2, "b")))
    path = saved_rig(tmp_path, one, other)
    file, track = mido.MidiFile(ticks_per_beat=480), mido.MidiTrack()
    file.tracks.append(track)
    track += [on(60), program(2).copy(time=240), off(60).copy(time=240)]
    file.save(tmp_path / "a.mid")
    audio = np.abs(engine.render(scene_of_file(engine.load(path), tmp_path / "a.mid").scene, 1.0).audio[:, 0])
    assert audio[40_000:].max() < 1e-3 * audio.max() < audio[20_000:22_000].max()


# --- the same live


def draw(scene: Scene, seed: int, frames: int) -> list[tuple[int, mido.Message]]:
    """Random notes, pedals, wheels and programs on three channels, at frames; keys are those of the parts."""
    rng, messages = random.Random(seed), list[tuple[int, mido.Message]]()
    for n in range(14):
        member = rng.choice(scene.rig.members)
        keys = keys_of(member.document["keyboard"])
        key, channel = rng.choice(keys) - member.table.transpose, member.table.channel or rng.randint(1, 3)
        begin = 0 if n == 0 else rng.randrange(frames * 3 // 4)
        messages.append((begin, on(max(0, min(127, key)), rng.randint(20, 127), channel)))
        messages.append((begin + rng.randrange(1, frames // 3), off(max(0, min(127, key)), channel)))
    for _ in range(3):
        channel = rng.randint(1, 3)
        messages.append((rng.randrange(1, frames), program(rng.choice([1, 2]), channel)))
        pedal = mido.Message("control_change", control=64, value=rng.choice([0, 127]), channel=channel - 1)
        messages.append((rng.randrange(1, frames), pedal))
    return sorted(messages, key=lambda one: one[0])


class Told:
    """A message at a frame."""

    def __init__(self, frame: int, message: mido.Message) -> None:
        self.frame, self.message = frame, message


RIGS = {
    "oscillators": (
        'patch = "bars.json"\nchannel = 1\nprogram = 1',
        'patch = "bars.json"\nchannel = 1\nprogram = 2\ntranspose = 7',
        'patch = "high.json"\npan = 0.3',
    ),
    "four instruments": (
        'patch = "marimba_keys"\nchannel = 1\npan = -0.4',
        'patch = "guitar"\nchannel = 2\nlevel = -3.0',
        'patch = "vibraphone"\nchannel = 1\nkeys = "F3..F6"\ncurve = 0.8',
        'patch = "kalimba_keys"\nchannel = 3',
    ),
    "a bow and a drum": (
        'patch = "violin"\nchannel = 1',
        'patch = "toms"\nchannel = 2',
        'patch = "sitar"\nchannel = 3\ntranspose = -12',
    ),
}
HARD = [pytest.param(name, marks=pytest.mark.hard) for name in list(RIGS)[1:]]


@pytest.mark.parametrize("name", ["oscillators", *HARD])
@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.hard) for n in (1, 2))])
def test_live_sound_is_the_sound_of_the_file(tmp_path, name, seed):
    """No sample differs, in blocks of several sizes, early and late, on one core and on two; and the log replays."""
    scene = engine.load(saved_rig(tmp_path, *RIGS[name]))
    frames = RATE // 2
    messages = draw(scene, seed, frames)
    file, track, now = mido.MidiFile(ticks_per_beat=TICKS), mido.MidiTrack(), 0
    file.tracks.append(track)
    for frame, message in messages:
        track.append(message.copy(time=frame - now))
        now = frame
    file.save(tmp_path / "a.mid")
    of_file = scene.model_copy(update={"midi": Midi(shortest_lift=0.0)})
    played = scene_of_file(of_file, tmp_path / "a.mid")
    rendering = engine.render(played.scene, seconds=frames / RATE, samplerate=RATE, kernel="general", cores=1)
    wanted = (np.asarray(rendering.audio).reshape(frames, -1) * GAIN).astype(np.float32)
    assert wanted.any()
    keys: dict[str, set[int]] = {member.name: set() for member in scene.rig.members}
    for body in played.scene.body:
        part, _, own = body.name.partition("__")
        member = next(one for one in scene.rig.members if one.name == part)
        keys[part] |= {key for key in keys_of(member.document["keyboard"]) if own.startswith(name_of(key))}
    needed = {part: sorted(some) for part, some in keys.items() if some}
    for way in (AT_ITS_FRAME, random.Random(seed).choice(WAYS)):
        player = make_player(live_rig(scene.rig, needed), waiting=True, cores=1 + seed % 2)
        allocator, zones = RigKeys(player, scene.rig), MpeZones(Midi())

        def tell(told, allocator=allocator, zones=zones):
            note = parse_message(told.message, 0.0, zones)
            allocator.play(note._replace(part=1), told.frame)

        audio = play_told(player, [Told(*one) for one in messages], frames, way, tell)
        assert player.meter().dropped == 0, way
        assert count_differences(audio, wanted) == 0, way
        assert count_differences(replay(json.loads(json.dumps(player.log()))), audio) == 0, way


def name_of(key: int) -> str:
    from engine.instrument.key_names import plain_note_name

    return f"{plain_note_name(key)}_"


# --- the command line


def test_a_rig_is_rendered_with_a_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    saved_rig(tmp_path, 'patch = "bars.json"\nkeys = "C2..B3"', 'patch = "high.json"\nkeys = "C4..C6"')
    file, track = mido.MidiFile(ticks_per_beat=480), mido.MidiTrack()
    file.tracks.append(track)
    track += [on(48), on(72).copy(time=240), on(30).copy(time=0), off(48).copy(time=240), off(72), off(30)]
    file.save("a.mid")
    assert main(["rig.toml", "--midi", "a.mid", "--seconds", "0.8", "-o", "a.wav", "--kernel", "general"]) == 0
    assert "F#1" not in capsys.readouterr().out and math.isfinite(Path("a.wav").stat().st_size)
    assert main(["check", "rig.toml"]) == 0
    assert main(["params", "rig.toml"]) == 0
    assert "body.bars__C4_bar.frequency" in capsys.readouterr().out


def test_a_rig_says_which_part_makes_all_others_dearer(tmp_path):
    """The finest setting of each part is that of all; one that the rig sets itself is nobody's."""
    for name, substeps in (("plain", 1), ("fine", 4)):
        text = json.dumps(KEYS | {"accuracy": {"substeps": substeps}})
        (tmp_path / f"{name}.json").write_text(text, "utf-8")
    parts = 'name = "low"\npatch = "plain.json"', 'name = "high"\npatch = "fine.json"'
    told = explain_accuracy(engine.load(saved_rig(tmp_path, *parts)).rig)
    assert told == "high asks for substeps = 4, which all parts take: an [accuracy] of the rig sets it"
    assert explain_accuracy(engine.load(saved_rig(tmp_path, *parts, head="[accuracy]\nsubsteps = 2\n")).rig) == ""
    assert explain_accuracy(engine.load(saved_rig(tmp_path, parts[0])).rig) == ""
