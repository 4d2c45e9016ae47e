"""Notes of a score that bend."""

import numpy as np
import pytest

import engine
from engine.faults import PatchError
from engine.instrument.bent_parameters import BentParameter, events_of_bends
from engine.instrument.score import PlayedNote

RATE = 44_100
STRINGS = {
    "seconds": 1.6,
    "keyboard": {"keys": "C4..E4"},
    "key": {
        "body": [{"name": "string", "kind": "string", "length": 0.6, "linear_density": 1e-3, "frequency": "= f"}],
        "on": [{"kind": "pluck", "body": "string", "at": 0.2, "amplitude": 1.0, "duration": 2e-3}],
        "pickup": [{"body": "string", "at": 0.1}],
    },
}


def pitch(audio, begin, near):
    """Cents of the loudest partial in a fifth of a second over a frequency, Hz."""
    part = audio[round(begin * RATE) : round((begin + 0.2) * RATE), 0]
    size = 1 << 19
    power = np.abs(np.fft.rfft(part * np.hanning(len(part)), size))
    frequency = np.fft.rfftfreq(size, 1 / RATE)
    within = np.abs(frequency / near - 1.0) < 0.3
    return 1200 * np.log2(frequency[within][np.argmax(power[within])] / near)


def test_a_note_sounds_as_high_as_its_bend_says():
    """Unbent, three semitones up, on the way half of it, and unbent where the key is pressed again."""
    bend = [[0.3, 0], [0.4, 3], [0.7, 3], [0.8, 1.5]]
    notes = [{"time": 0.0, "key": "C4", "bend": bend}, {"time": 1.2, "key": "C4"}]
    rendering = engine.render(engine.load(STRINGS | {"note": notes}), samplerate=RATE)
    found = [pitch(rendering.audio, begin, 261.6256) for begin in (0.05, 0.45, 0.9, 1.3)]
    assert found == pytest.approx([0.0, 300.0, 150.0, 0.0], abs=4.0)
    assert rendering.stats.energy.error_max < 1e-10


def test_a_bend_is_one_of_its_key_alone():
    events = events_of_bends(
        [BentParameter(60, "body.C4_string.tension", 10.0, 2), BentParameter(62, "body.D4_string.frequency", 300.0, 1)],
        [PlayedNote(0.0, 60, 80, 1.0, 64, ((0.1, 12.0), (0.4, 12.0), (0.5, 0.0))), PlayedNote(0.3, 62, 80, 1.0, 64)],
        10.0,
    )
    told = [(e["time"], e["parameter"], e["value"], e["duration"]) for e, _, _ in events]
    assert told == [
        (0.0, "body.C4_string.tension", 40.0, 0.0),
        (0.4, "body.C4_string.tension", 10.0, pytest.approx(0.1)),
    ]


def test_the_next_note_of_a_key_ends_a_bend():
    """What has not begun by then never does, and the next note begins unbent."""
    notes = [PlayedNote(0.0, 60, 80, 1.0, 64, ((0.0, 0.0), (0.5, 2.0), (2.0, 0.0))), PlayedNote(0.4, 60, 80, 1.0, 64)]
    events = events_of_bends([BentParameter(60, "x", 100.0, 1)], notes, 10.0)
    told = [(event["time"], event["value"]) for event, _, _ in events]
    assert told == [(0.0, pytest.approx(112.246, abs=1e-3)), (0.4, 100.0)]


def test_bends_after_the_end_are_left_out():
    notes = [PlayedNote(0.0, 60, 80, 1.0, 64, ((0.2, 0.0), (0.3, 1.0), (0.6, 0.0), (0.7, 2.0)))]
    events = events_of_bends([BentParameter(60, "x", 100.0, 1)], notes, 0.5)
    assert [event["time"] for event, _, _ in events] == [0.2, 0.3]


@pytest.mark.parametrize(
    ("bend", "message"),
    [
        ([[0.2, 0], [0.1, 1]], "the times of the bend do not increase"),
        ([[-0.2, 0]], "the times of the bend do not increase"),
        ([[0.2, 30]], "a bend of more than 24 semitones"),
        ([[0.2]], "bend"),
        ([["now", 1]], "bend"),
    ],
)
def test_what_is_no_bend_is_refused(bend, message):
    with pytest.raises(PatchError, match=message):
        engine.load(STRINGS | {"note": [{"time": 0.0, "key": "C4", "bend": bend}]})


def test_a_key_without_a_pitch_does_not_bend():
    bars = {
        "keyboard": {"keys": "C4..E4"},
        "key": {"body": [{"name": "m", "kind": "mass", "mass": 1.0}], "pickup": [{"body": "m"}]},
    }
    with pytest.raises(PatchError, match="the key C4 has no body with a frequency or a tension"):
        engine.load(bars | {"note": [{"time": 0.0, "key": "C4", "bend": [[0, 1]]}]})
