"""Where several channels send notes, the controllers of each move the voices or keys that it plays, and no others."""

import math
import random
import tomllib

import mido
import numpy as np
import pytest
from conftest import ROOT
from smf import Timed, cc, off, on, rpn, smf, track

import engine
from engine.live.controls import Controls
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi import RENDER_GAIN, lowest_ratio, render_notes
from engine.live.midi_parts import Excerpt
from engine.live.midi_port import MidiPort
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import VoiceAllocator

RATE, TICKS = 48_000, 24_000  # one tick is one frame
STEP, VOICES = 240, 4  # frames between two steps of a control
FELT = {"kind": "cc", "number": 1, "parameter": "contact.felt.stiffness", "range": [1e8, 1e10], "smoothing": 0.0}
PRESSURE = {key: value for key, value in FELT.items() if key != "number"} | {"kind": "pressure"}
OF_PATCH = 4.5e9


def controlled(*controls: dict, **midi: object) -> engine.Scene:
    """The piano string with some controls."""
    table = engine.load(ROOT / "patches" / "piano_c4.toml").model_dump(exclude_unset=True)
    return engine.Scene.model_validate(table | {"control": list(controls), "midi": {"shortest_lift": 0.0} | midi})


def pressed(value: int, channel: int) -> bytes:
    """Return a channel pressure."""
    return bytes([0xD0 | channel - 1, value])


def save(told: list[tuple[int, bytes]], folder) -> str:
    """Save messages, each at a frame, as a file."""
    frames = [0, *(frame for frame, _ in told)]
    timed: list[Timed] = [(frame - before, data) for before, (frame, data) in zip(frames, told, strict=False)]
    (folder / "x.mid").write_bytes(smf(track(*timed), division=TICKS))
    return str(folder / "x.mid")


def stiffness_by_channel(player: Player, keys: VoiceAllocator) -> dict[int, float]:
    """Return what the felt of the last note of each channel has come to, N/m^2.5."""
    voices = sorted((voice.since, n) for n, voice in enumerate(keys._voices) if voice.key is not None)
    return {
        keys._voices[n].key.channels.channel: player.state.potential_coefficient[n] * 3.5  # type: ignore[union-attr]
        for _, n in voices
    }


NOTES = [(0, on(60)), (0, on(64, channel=2))]
CASES = {  # what is told, and the stiffness of each channel's felt
    "each its own": ([*NOTES, (4800, cc(1, 0)), (4800, cc(1, 127, 2))], {1: 1e8, 2: 1e10}),
    "one of two": ([*NOTES, (4800, cc(1, 0, 2))], {1: OF_PATCH, 2: 1e8}),
    "before the notes": ([(0, cc(1, 0)), (0, cc(1, 127, 2)), *NOTES], {1: 1e8, 2: 1e10}),
    "a third channel, by a voice that another one had": (
        [*NOTES, (0, on(65)), (0, on(66)), (4800, cc(1, 0)), (9600, on(67, channel=3))],
        {1: 1e8, 2: OF_PATCH, 3: OF_PATCH},
    ),
    "a move while the next note is told ahead": (
        [(0, on(60)), (0, on(61)), (0, on(62)), (0, on(63)), (12_000, cc(1, 0)), (12_960, on(64, channel=2))],
        {1: 1e8, 2: OF_PATCH},
    ),
    "a channel that comes back": (
        [(0, cc(1, 127)), (0, on(60)), (4800, cc(1, 0, 2)), (4800, on(64, channel=2)), (9600, on(65))],
        {1: 1e10, 2: 1e8},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_voice_has_the_value_of_its_channel(case, tmp_path):
    told, wanted = CASES[case]
    path = save([*told, (19_200, off(60))], tmp_path)
    played = render_notes(controlled(FELT), path, RATE, Excerpt(seconds=0.5), VOICES)
    found = stiffness_by_channel(played.player, played.keys)
    assert found == {channel: pytest.approx(value) for channel, value in wanted.items()}
    assert played.player.meter()["energy_error"] <= 1e-12


def test_a_member_s_pressure_ends_with_its_notes(tmp_path):
    """In an MPE zone, a voice that had a note of a pressed member does not keep the pressure for another one's."""
    zone = [(0, data) for _, data in rpn(6, (6, 7))]
    told = [*zone, (0, on(60, channel=2)), (4800, pressed(127, 2)), (9600, off(60, channel=2))]
    told += [(9600 + 480 * n, on(61 + n, channel=3)) for n in range(VOICES)]
    played = render_notes(
        controlled(PRESSURE), save([*told, (19_200, off(61, channel=3))], tmp_path), RATE, Excerpt(seconds=0.5), VOICES
    )
    assert all(voice.key and voice.key.channels.channel == 3 for voice in played.keys._voices)
    np.testing.assert_allclose(played.player.state.potential_coefficient * 3.5, OF_PATCH)


class Port:
    """A port to which messages are told at their frames, while the controls make their steps."""

    def __init__(self, scene, player, keys, monkeypatch):
        monkeypatch.setattr("engine.live.midi_port.open_port", mido.ports.EchoPort)
        self.player, self.controls, self.sound = player, Controls(scene, player), []
        self.port = MidiPort("Keys", lambda: keys, self.controls)

    def send(self, *messages: bytes):
        for message in messages:
            self.port._port.send(mido.Message.from_bytes(message))
            self.port.poll()

    def play_until(self, frame: int):
        while self.player.frame < frame:
            if self.player.frame % STEP == 0:
                self.controls.poll()
            out = np.zeros(
                (min(frame, (self.player.frame // STEP + 1) * STEP) - self.player.frame, self.player.channels),
                np.float32,
            )
            self.player.render_into(out)
            self.sound.append(out)


def draw(seed: int) -> list[tuple[int, bytes]]:
    """Draw notes and moves of two channels. Moves are where steps are made, of which a port knows no others."""
    rng, told = random.Random(seed), [(0, on(60)), (9600, off(60))]
    for _ in range(12):
        begin, channel, key = rng.randrange(24_000), rng.choice([1, 2]), rng.randrange(57, 70)
        told += [(begin, on(key, 80, channel)), (begin + rng.randrange(480, 6000), off(key, 64, channel))]
        told.append((STEP * rng.randrange(100), cc(1, rng.randrange(128), rng.choice([1, 2]))))
    return sorted(told, key=lambda one: (one[0], one[1][0] & 0xF0 != 0xB0))


@pytest.mark.hard
@pytest.mark.parametrize("smoothing", [0.0, 0.03])
@pytest.mark.parametrize("seed", range(3))
def test_a_port_told_at_its_frames_gives_the_samples_of_the_file(seed, smoothing, tmp_path, monkeypatch):
    scene, told, frames = controlled(FELT | {"smoothing": smoothing}, channels="apart"), draw(seed), 28_800
    path = save(told, tmp_path)
    rendered = render_notes(scene, path, RATE, Excerpt(seconds=frames / RATE), VOICES)
    lowest = lowest_ratio(path, scene)
    player = Player(scene, RATE, math.inf, RENDER_GAIN, voices=VOICES, lowest=lowest)
    player.counters[Slot.FADE_IN_FRAMES] = 0
    keys = VoiceAllocator(player)
    port = Port(scene, player, keys, monkeypatch)
    for frame, data in told:
        port.play_until(frame)
        port.send(data)
    port.play_until(frames)
    sound = np.concatenate(port.sound)
    assert {data[0] & 0x0F for _, data in told} == {0, 1} and np.abs(sound).max() > 0.0
    np.testing.assert_array_equal(sound / RENDER_GAIN, rendered.audio)
    assert stiffness_by_channel(player, keys) == stiffness_by_channel(rendered.player, rendered.keys)


@pytest.mark.parametrize(("setting", "value"), [("auto", OF_PATCH), ("apart", OF_PATCH), ("together", 1e8)])
def test_at_a_port_the_setting_says_whose_voices_a_control_moves(setting, value, monkeypatch):
    scene = controlled(FELT, channels=setting)
    player = Player(scene, RATE, math.inf, RENDER_GAIN, voices=VOICES, lowest=0.5)
    keys = VoiceAllocator(player)
    port = Port(scene, player, keys, monkeypatch)
    port.send(on(60), on(64, channel=2))
    port.play_until(STEP)
    port.send(cc(1, 0))
    port.play_until(8 * STEP)
    assert stiffness_by_channel(player, keys) == {1: pytest.approx(1e8), 2: pytest.approx(value)}


@pytest.mark.parametrize(("setting", "value"), [("auto", OF_PATCH), ("together", 1e8)])
def test_at_a_port_a_control_moves_the_keys_of_its_channel_and_what_all_share(setting, value, monkeypatch):
    document = tomllib.loads((ROOT / "patches" / "templates" / "piano.toml").read_text("utf-8"))
    document["key"]["contact"][0] |= {"name": "felt", "stiffness": OF_PATCH}
    shared = document["body"][0]["name"]
    board = {"kind": "cc", "number": 2, "parameter": f"body.{shared}.sigma0", "range": [1.0, 40.0], "smoothing": 0.0}
    document["body"][0]["sigma0"] = 10.0
    document |= {"control": [FELT, board], "midi": {"channels": setting}}
    scene = live_scene(engine.Scene.model_validate(document), [60, 64, 67])
    player = Player(scene, RATE, math.inf, RENDER_GAIN, waiting=True)
    keys = KeyAllocator(player)
    port = Port(scene, player, keys, monkeypatch)
    port.send(on(60), on(64, channel=2), cc(1, 0), cc(2, 0))
    port.play_until(4 * STEP)
    felt = {name: player.value(next(p for p in player.live_paths if p.startswith(f"contact.{name}_felt")
            and p.endswith("stiffness"))) for name in ("C4", "E4", "G4")}  # fmt: skip
    assert felt == {"C4": 1e8, "E4": value, "G4": 1e8}  # no channel has played G4 yet
    assert player.value(f"body.{shared}.sigma0") == 1.0
    port.send(on(67, channel=2))
    port.play_until(8 * STEP)
    name = next(path for path in player.live_paths if path.startswith("contact.G4_felt") and path.endswith("stiffness"))
    assert player.value(name) == value
    assert player.value(f"body.{shared}.sigma0") == 1.0
