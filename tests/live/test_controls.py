"""Controls: a knob, a wheel or a number of OSC changes what the patch says, smoothly, and energy stays in balance."""

import json
import math
import tomllib

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.live.controls import Controls, approach, targets_of_all
from engine.live.hot_reload import changed_parameters
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Move
from engine.live.midi_port import take_message
from engine.live.mpe import MpeZones
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.voice_allocator import VoiceAllocator
from engine.patch.control_tables import Midi

PIANO = ROOT / "patches" / "piano_c4.toml"
FELT = {"kind": "cc", "number": 1, "parameter": "contact.felt.stiffness", "range": [1e8, 1e10], "curve": "exponential"}
STRING = "body.string.frequency"


def controlled(*controls: dict, **more: object) -> engine.Scene:
    """The piano string with some controls."""
    table = engine.load(PIANO).model_dump(exclude_unset=True) | {"control": list(controls)} | more
    return engine.Scene.model_validate(table)


def turned(scene: engine.Scene, *moves: Move, seconds: float = 0.5, player: Player | None = None) -> Player:
    """A player after some moves, each 10 ms after the one before."""
    player = player or Player(scene, gain=1e-3, seconds=math.inf)
    controls = Controls(scene, player)
    out = np.zeros((441, player.channels), np.float32)
    for n in range(round(seconds / 0.01)):
        if n < len(moves):
            controls.move(moves[n])
        controls.poll()
        player.render_into(out)
    assert not controls.refused
    return player


@pytest.mark.parametrize(
    ("curve", "share", "value"),
    [("linear", 0.0, 1e8), ("linear", 0.5, 5.05e9), ("exponential", 0.5, 1e9), ("exponential", 1.0, 1e10)],
)
def test_a_controller_goes_through_its_range(curve, share, value):
    player = turned(controlled(FELT | {"curve": curve}), Move("cc", 1, 3, share))
    stiffness = player.state.potential_coefficient[0] * 3.5  # N/m^2.5
    assert stiffness == pytest.approx(value, rel=2e-3) and player.value(FELT["parameter"]) == pytest.approx(value)
    assert player.meter()["energy_error"] <= 1e-12


def test_a_control_takes_what_it_says_and_nothing_else():
    """The controller and the channel of the control; bend, pressure and other controllers leave it."""
    scene = controlled(FELT | {"channel": 2})
    others = [Move("cc", 1, 1, 1.0), Move("cc", 2, 2, 1.0), Move("bend", 0, 2, 1.0), Move("pressure", 0, 2, 1.0)]
    assert turned(scene, *others, seconds=0.05).log()["events"] == []
    assert turned(scene, Move("cc", 1, 2, 1.0), seconds=0.05).log()["events"]


def test_a_move_is_smoothed():
    """63 % of a move in the time of smoothing, 95 % in three times that; then nothing more is sent."""
    assert approach(0.0, 1.0, 0.1, 0.1) == pytest.approx(1 - math.exp(-1))
    assert approach(0.0, 1.0, 0.1, 0.0) == 1.0
    scene = controlled(FELT | {"range": [0.0, 1e10], "curve": "linear", "smoothing": 0.1})
    start = Player(scene).value(FELT["parameter"]) / 1e10
    for seconds, made in ((0.1, 1 - math.exp(-1)), (0.3, 1 - math.exp(-3))):
        player = turned(scene, Move("cc", 1, 1, 1.0), seconds=seconds + 0.02)
        share = (player.state.potential_coefficient[0] * 3.5 / 1e10 - start) / (1 - start)
        assert share == pytest.approx(made, abs=0.15)
    long = turned(scene, Move("cc", 1, 1, 1.0), seconds=2.0)
    assert max(event["frame"] for event in long.log()["events"]) < 1.2 * 44_100


@pytest.mark.hard
def test_a_pitch_wheel_bends_a_string_as_built_so():
    """After the move, the string has the coefficients of one built a fourth higher; energy is in balance, and a replay
    of the log is the same sound, bit for bit."""
    scene = controlled({"kind": "bend", "parameter": STRING, "range": [200.0, 350.0], "smoothing": 0.005})
    player = Player(scene, gain=1e-3, seconds=math.inf)
    turned(scene, Move("bend", 0, 1, 1.0), seconds=0.1, player=player)
    built = Player(controlled(body=[scene.body[0].model_dump(exclude_unset=True) | {"frequency": 350.0},
                                    scene.body[1].model_dump(exclude_unset=True)]))  # fmt: skip
    count = built.model.step.kick.size - 2  # above, a string so high has no more modes
    for name in ("kick", "drift", "spring_kick"):
        np.testing.assert_array_equal(getattr(player.model.step, name)[:count], getattr(built.model.step, name)[:count])
    heard = player.fetch_recording()
    again = replay(json.loads(json.dumps(player.log())))
    np.testing.assert_array_equal(heard, again[: len(heard)])
    assert player.meter()["energy_error"] <= 1e-12


@pytest.mark.parametrize("path", ["body.string.sigma0", "pickup.0.gain", "pickup.0.at", "contact.felt.loss"])
def test_damping_gain_and_place_are_turned(path):
    """To ten times less, in steps: what is heard afterwards is what a patch of that value gives; energy in balance."""
    scene = engine.load(PIANO)
    player = Player(scene, gain=1e-3, seconds=math.inf)
    value = player.value(path) / 10
    player.set(path, value, seconds=0.01)
    out = np.zeros((4410, player.channels), np.float32)
    player.render_into(out)
    assert player.value(path) == value
    table = scene.model_dump(exclude_unset=True)
    section, name, key = path.split(".")
    number = int(name) if name.isdigit() else [t.get("name") for t in table[section]].index(name)
    table[section][number][key] = value
    built = Player(engine.Scene.model_validate(table))
    where = {"sigma0": "step.loss.decay_factor", "gain": "pickups.gain", "at": "pickups.rows.phi"}.get(key)
    ours, theirs = player.model, built.model
    for part in (where or "step.contact.loss_rate").split("."):
        ours, theirs = getattr(ours, part), getattr(theirs, part)
    np.testing.assert_array_equal(ours, theirs)
    assert player.meter()["energy_error"] <= 1e-12 and player.meter()["dropped"] == 0


def test_a_value_that_cannot_be_is_refused_and_nothing_has_changed():
    player = Player(engine.load(PIANO))
    before = player.model.step.kick.copy()
    with pytest.raises(ValueError, match=r"body.string.frequency = -1 is out of range; 0.001 to 1e6 Hz"):
        player.set(STRING, -1.0)
    with pytest.raises(ValueError, match="no mode below"):
        player.set(STRING, 3e5, seconds=0.0)
    player.render_into(np.zeros((512, player.channels), np.float32))
    np.testing.assert_array_equal(player.model.step.kick, before)
    assert player.value(STRING) == engine.load(PIANO).body[0].frequency


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"parameter": "contact.velt.stiffness"},
            "no live parameter contact.velt.stiffness; the live parameters are contact.felt",
        ),
        ({"parameter": "seconds"}, "no live parameter seconds"),
        ({"range": [1e8, -1.0]}, "contact.felt.stiffness = -1 is out of range"),
        (
            {"range": [0.0, 1e9]},
            "an exponential curve cannot go from 0 to 1e\\+09; give two numbers above 0, or a linear curve",
        ),
        ({"number": 128}, "less than or equal to 119"),
        ({"kind": "knob"}, "'cc', 'bend', 'pressure', 'poly_pressure', 'osc'"),
    ],
)
def test_a_wrong_control_is_explained(change, said):
    with pytest.raises(ValueError, match=said):
        controlled(FELT | change)


# --- MPE


class Message:
    """A message as mido has it."""

    def __init__(self, kind: str, channel: int, **values: int) -> None:
        self.type, self.channel = kind, channel - 1
        self.__dict__.update(values)


def rpn(channel: int, parameter: int, value: int) -> list[Message]:
    """A registered parameter, set on a channel."""
    pairs = ((101, 0), (100, parameter), (6, value))
    return [Message("control_change", channel, control=control, value=given) for control, given in pairs]


def test_zones_are_set_by_the_controller():
    zones = MpeZones(Midi())
    assert zones.channels(3) == (3, 0) and zones.bend_cents(3, 8191) == pytest.approx(200.0, rel=1e-3)
    assert all(zones.feed(message) for message in rpn(1, 6, 7))
    assert zones.channels(3) == (3, 1) and zones.channels(8) == (8, 1) and zones.channels(9) == (9, 0)
    assert zones.bend_cents(3, -8192) == -4800.0 and zones.bend_cents(1, -8192) == -200.0
    assert zones.is_of_one_note(3) and not zones.is_of_one_note(1) and not zones.is_of_one_note(9)
    for message in rpn(4, 0, 24):
        zones.feed(message)
    assert zones.bend_cents(3, -8192) == -2400.0
    for message in rpn(16, 6, 12):  # the upper zone takes channels from the lower
        zones.feed(message)
    assert (zones.channels(4) == (4, 16) and zones.channels(3) == (3, 1)) or zones.channels(2) == (2, 1)
    assert not zones.feed(Message("control_change", 1, control=74, value=3))


def test_each_note_of_a_zone_has_its_bend_and_pressure():
    """Two notes on two channels: one is bent by an octave and pressed; the other, and what it touches, stays."""
    pressed = {"kind": "pressure", "smoothing": 0.0} | {key: FELT[key] for key in ("parameter", "range")}
    scene = controlled(pressed, midi={"mpe_lower": 15})
    player = Player(scene, gain=1e-3, seconds=math.inf, voices=2, lowest=0.5)
    keys, controls, zones = VoiceAllocator(player), Controls(scene, player), MpeZones(scene.midi)
    out = np.zeros((2205, player.channels), np.float32)

    def take(*messages: Message) -> None:
        for message in messages:
            take_message(message, zones, keys, controls)
        player.render_into(out)
        controls.poll()
        player.render_into(out)

    def kicks() -> np.ndarray:
        mode = player.model.islands.mode
        half = mode[(mode.size - 1) // 2]
        return np.stack([player.model.step.spring_kick[:half], player.model.step.spring_kick[half:]])

    take(Message("note_on", 2, note=60, velocity=64), Message("note_on", 3, note=60, velocity=64))
    before, (first, second) = kicks(), [n for n, voice in enumerate(keys._voices) if voice.key]
    np.testing.assert_array_equal(before[0], before[1])
    held = [voice.key for voice in keys._voices]
    low, high = (held.index(key) for key in sorted(key for key in held if key))
    assert {first, second} == {low, high}
    take(Message("pitchwheel", 3, pitch=8191 // 4), Message("aftertouch", 3, value=127))
    after, stiffness = kicks(), player.state.potential_coefficient * 3.5
    np.testing.assert_array_equal(after[low], before[low])
    assert np.any(after[high] != before[high])
    assert stiffness[high] == pytest.approx(1e10) and stiffness[low] == pytest.approx(4.5e9)
    take(Message("pitchwheel", 1, pitch=-8192))  # of the master: both go down by two semitones
    last = kicks()
    assert np.any(last[low] != after[low]) and np.any(last[high] != after[high])
    assert player.meter()["energy_error"] <= 1e-12


# --- the same numbers from the score, and of an edited patch


SCORE = [
    {"time": 0.02, "parameter": STRING, "value": 330.0, "duration": 0.02},
    {"time": 0.03, "parameter": "pickup.0.gain", "value": 0.1, "duration": 0.01},
    {"time": 0.05, "parameter": "body.string.sigma0", "value": 20.0},
    {"time": 0.06, "parameter": "contact.felt.stiffness", "value": 1e9},
]


def scored(*changes: dict) -> engine.Scene:
    return controlled(event=[{"kind": "change"} | change for change in changes])


@pytest.mark.hard
def test_the_score_changes_what_a_control_does():
    """Rendered, with or without a trace, and played, in blocks of any size: the same bits; energy in balance; a replay
    does not do it twice. And the stiffness, by its path or by its contact, is the same event."""
    scene = scored(*SCORE)
    rendering = engine.render(scene, seconds=0.1, trace=True)
    np.testing.assert_array_equal(rendering.audio, engine.render(scene, seconds=0.1).audio)
    assert rendering.stats.energy.error_max <= 1e-12
    player, sizes = Player(scene, gain=1e-3, seconds=math.inf), np.random.default_rng(0).integers(1, 700, 100)
    ends = np.minimum(4410, np.cumsum(sizes))
    played = np.zeros((4410, player.channels), np.float32)
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        player.render_into(played[begin:end])
    faded_in = 300
    np.testing.assert_array_equal(played[faded_in:], (rendering.audio[faded_in:] * 1e-3).astype(np.float32))
    np.testing.assert_array_equal(replay(json.loads(json.dumps(player.log()))), played)
    plain = scored(*SCORE[:3], {"time": 0.06, "contact": "felt", "stiffness": 1e9})
    assert plain.event == scene.event


def test_a_scored_pitch_is_heard():
    """A string that glides from C4 to E4 then rings at 330 Hz."""
    audio = engine.render(scored(SCORE[0]), seconds=0.5).audio[:, 0]
    part = audio[4410:] * np.hanning(len(audio) - 4410)
    spectrum = np.abs(np.fft.rfft(part, 1 << 19))
    low, high = (round(f * (1 << 19) / 44_100) for f in (200.0, 400.0))
    assert (low + np.argmax(spectrum[low:high])) * 44_100 / (1 << 19) == pytest.approx(330.0, abs=0.5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"parameter": "body.string.colour", "value": 1.0},
            "no live parameter body.string.colour; the live parameters are body.str",
        ),
        ({"parameter": STRING, "value": -1.0}, "body.string.frequency = -1 is out of range"),
        ({"parameter": STRING}, "no value is given; give the value that it glides to"),
        ({"parameter": STRING, "value": 1.0, "stiffness": 1.0}, "parameter and stiffness are both given"),
        ({"parameter": STRING, "value": 1.0, "contact": "felt"}, "both contact and parameter are given"),
        ({"contact": "felt", "stiffness": 1.0, "value": 1.0}, "value is given; a contact has a stiffness"),
    ],
)
def test_a_wrong_change_is_explained(change, said):
    with pytest.raises(ValueError, match=said):
        scored({"time": 0.01} | change)


def test_a_moved_pickup_of_acceleration_hears_no_step():
    """On a drum, where pickups hear acceleration: a place that moves brings no spike."""
    scene = engine.load(ROOT / "patches" / "ball_on_drum.toml")
    heard = []
    for places in ([], [0.4, 0.45]):
        player = Player(scene, gain=1e-6, seconds=math.inf)
        out = np.zeros((8820, player.channels), np.float32)
        player.render_into(out[:4410])
        for n, place in enumerate(places):
            player.set(f"pickup.0.at.{n}", place, seconds=0.0)
        player.render_into(out[4410:])
        heard.append(np.abs(out[4410:, 0]).max())
        assert player.meter()["energy_error"] <= 1e-12
    assert heard[1] <= 3 * heard[0]


def test_what_is_edited_glides_unless_it_needs_other_tables():
    old = engine.load(PIANO)
    table = old.model_dump(exclude_unset=True)
    table["body"][0] |= {"frequency": 280.0, "sigma0": 1.0}
    table["pickup"][0] |= {"at": 0.4, "gain": 2.0}
    wanted = {STRING: 280.0, "body.string.sigma0": 1.0, "pickup.0.at": 0.4, "pickup.0.gain": 2.0}
    assert changed_parameters(old, engine.Scene.model_validate(table)) == wanted
    table["body"][0] |= {"modes": 20}
    assert changed_parameters(old, engine.Scene.model_validate(table)) is None


def test_an_instrument_moves_what_each_key_has():
    """A control of all keys, and the pressure of one key; what the patch names once stands for the copies of a key."""
    felt = {"parameter": "contact.felt.stiffness", "range": [1e8, 1e10], "smoothing": 0.0}
    document = tomllib.loads((ROOT / "patches" / "templates" / "piano.toml").read_text("utf-8"))
    document["key"]["contact"][0]["name"] = "felt"
    controls = [felt | {"kind": "cc", "number": 1}, felt | {"kind": "poly_pressure"}]
    scene = live_scene(engine.Scene.model_validate(document | {"control": controls}), [60, 62])
    player = Player(scene, seconds=math.inf, waiting=True)
    keys, moved, zones = KeyAllocator(player), Controls(scene, player), MpeZones(scene.midi)
    paths = targets_of_all(player, felt["parameter"])
    of_key = [path for path in paths if path.startswith("contact.C4_")]
    assert 0 < len(of_key) < len(paths)
    for message, chosen, value in (
        (Message("control_change", 1, control=1, value=127), paths, 1e10),
        (Message("polytouch", 1, note=60, value=0), of_key, 1e8),
    ):
        take_message(message, zones, keys, moved)
        moved.poll()
        player.render_into(np.zeros((512, player.channels), np.float32))
        assert all(player.value(path) == value for path in chosen)
    assert all(player.value(path) == 1e10 for path in paths if path not in of_key)
