"""What the messages of a channel do in a file, at a port and in an MPE zone: heard as pitch, level and length."""

import pytest
from bars import A3, ENDED, HELD, TAIL, VOICE, cents, level, rendered, write_bars
from smf import cc, lengths, off, on, read, rpn, smf, track, wheel

import engine
from engine.live.instrument_notes import scene_of_file
from engine.live.midi_files import delay_pedals
from engine.live.midi_notes import Note
from engine.patch.control_tables import Midi

bars = pytest.fixture(write_bars)


# --- pitch

NRPN = [(0, cc(99, 1)), (0, cc(98, 32))]
PITCHES = {  # cents of A3
    "an NRPN after the range": (100, track(*rpn(0, (6, 2)), *NRPN, (0, cc(6, 10)), (0, wheel(4096)), *A3)),
    "an NRPN before the range": (250, track(*NRPN, (0, cc(6, 10)), *rpn(0, (6, 5)), (0, wheel(4096)), *A3)),
    "an NRPN whose parts come apart": (100, track(*rpn(0, (6, 2)), NRPN[1], (0, cc(6, 9)), (0, wheel(4096)), *A3)),
    "an NRPN after a zone is chosen": (100, track(*rpn(6), *NRPN, (0, cc(6, 5)), (0, wheel(4096)), *A3)),
    "a null parameter": (100, track(*rpn(0, (6, 2)), *rpn(0x3FFF, (6, 12)), (0, wheel(4096)), *A3)),
    "1 semitone and 50 cents": (150, track(*rpn(0, (6, 1), (38, 50)), (0, wheel(8191)), *A3)),
    "0 semitones and 25 cents": (25, track(*rpn(0, (6, 0), (38, 25)), (0, wheel(8191)), *A3)),
    "12 semitones down": (-600, track(*rpn(0, (6, 12)), (0, wheel(-4096)), *A3)),
    "fine tuning of 50 cents": (50, track(*rpn(1, (6, 96), (38, 0)), *A3)),
    "fine tuning of -25 cents": (-25, track(*rpn(1, (6, 48), (38, 0)), *A3)),
    "fine tuning of 12.5 cents by its low bits": (12.5, track(*rpn(1, (6, 72), (38, 0)), *A3)),
    "coarse tuning of 2": (200, track(*rpn(2, (6, 66)), *A3)),
    "coarse tuning of -3": (-300, track(*rpn(2, (6, 61), (38, 0)), *A3)),
    "both tunings and the wheel": (350, track(*rpn(2, (6, 66)), *rpn(1, (6, 96)), (0, wheel(4096)), *A3)),
    "tuning of another channel": (0, track(*rpn(2, (6, 66), channel=2), *A3)),
    "a range that changes while the wheel is up": (500, track((0, wheel(4096)), *rpn(0, (6, 10)), *A3)),
    "reset after the wheel": (0, track((0, wheel(8191)), (10, cc(121, 0)), *A3)),
    "reset of another channel": (200, track((0, wheel(8191)), (10, cc(121, 0, 2)), *A3)),
    "reset keeps the range": (500, track(*rpn(0, (6, 10)), (0, cc(121, 0)), (0, wheel(4096)), *A3)),
    "data after a reset": (100, track(*rpn(0), (0, cc(121, 0)), (0, cc(6, 12)), (0, wheel(4096)), *A3)),
    "a zone of 5, then of 0": (
        4.2,
        track(*rpn(6, (6, 5)), *rpn(6, (6, 0)), (0, wheel(171, 2)), (0, on(57, channel=2)), (960, off(57, channel=2))),
    ),
    "a zone that ends while its wheel is up": (
        0,
        track(*rpn(6, (6, 5)), (0, wheel(8191, 2)), *rpn(6, (6, 0)), (9, on(57, channel=2)), (960, off(57, channel=2))),
    ),
    "a range from before the zone on the master": (
        100,
        track(*rpn(0, (6, 12)), *rpn(6, (6, 5)), (0, wheel(4096)), (0, on(57, channel=2)), (960, off(57, channel=2))),
    ),
    "a range from before the zone on a member": (
        600,
        track(*rpn(0, (6, 2), channel=3), *rpn(6, (6, 5)), (0, wheel(1024, 3)), (0, on(57, channel=3)), *TAIL),
    ),
    "member and master of a zone": (
        300,
        track(*rpn(6, (6, 5)), (0, wheel(341, 2)), (0, wheel(4096)), (0, on(57, channel=2)), (960, off(57, channel=2))),
    ),
    "a member left out of a smaller zone": (
        100,
        track(*rpn(6, (6, 5)), *rpn(6, (6, 2)), (0, wheel(4096, 5)), (0, on(57, channel=5)), (960, off(57, channel=5))),
    ),
}


@pytest.mark.parametrize("name", PITCHES)
def test_a_file_has_this_pitch(bars, tmp_path, name):
    expected, part = PITCHES[name]
    assert cents(rendered(bars, smf(part), tmp_path, seconds=0.8), 57) == pytest.approx(expected, abs=2.0)


@pytest.mark.parametrize("name", list(PITCHES)[::3])
def test_voices_have_this_pitch(tmp_path, name):
    expected, part = PITCHES[name]
    assert cents(rendered(VOICE, smf(part), tmp_path, seconds=0.8), 57) == pytest.approx(expected, abs=4.0)


APART = {  # bends of 57 on channel 1 and 63 on channel 2, cents
    "wheel of 2": ([wheel(8191, 2)], (0, 200)),
    "wheel of 1": ([wheel(-4096, 1)], (-100, 0)),
    "wheel of 2, then the reset of 1": ([wheel(8191, 2), wheel(0, 1)], (0, 200)),
    "both": ([wheel(8191, 2), wheel(-8192, 1)], (-200, 200)),
    "range of 1": ([cc(101, 0), cc(100, 0), cc(6, 4), wheel(4096), wheel(4096, 2)], (200, 100)),
    "wheel of 3": ([wheel(8191, 3)], (0, 0)),
}


@pytest.mark.parametrize("tracks", [1, 2])
@pytest.mark.parametrize("name", APART)
def test_the_wheel_of_a_channel_bends_its_notes(bars, tmp_path, name, tracks):
    """In one track or in two, whichever has the message."""
    messages, expected = APART[name]
    moves = [(0, message) for message in messages]
    first, second = [(0, on(57))], [(0, on(63, channel=2))]
    ends = [(960, off(57)), (0, off(63, channel=2))]
    parts = (
        [track(*moves, *first, *second, *ends)]
        if tracks == 1
        else [track(*first, ends[0]), track(*moves, *second, (960, off(63, channel=2)))]
    )
    sound = rendered(bars, smf(*parts), tmp_path, seconds=0.8)
    assert [cents(sound, 57, 3), cents(sound, 63, 3)] == pytest.approx(expected, abs=2.0)


# --- level

OFFS = [(480, off(57)), (0, off(63, channel=2))]
PRESSED = [(0, on(57)), (0, on(63, channel=2))]
LEVELS = {  # whether 57 of channel 1 and 63 of channel 2 sound on a second later
    "pedal of 1 down, 2 lifts its own": ([cc(64, 127), cc(64, 0, 2)], [], (True, False)),
    "pedal of 2": ([cc(64, 127, 2)], [], (False, True)),
    "both pedals": ([cc(64, 127), cc(64, 127, 2)], [], (True, True)),
    "both, and 1 lifts its own": ([cc(64, 127), cc(64, 127, 2)], [cc(64, 0)], (False, True)),
    "half a pedal of 2 lifts little": ([cc(64, 127), cc(64, 40, 2)], [], (True, False)),
    "pedal of 3": ([cc(64, 127, 3)], [], (False, False)),
    "reset of 1": ([cc(64, 127), cc(64, 127, 2)], [cc(121, 0)], (False, True)),
    "all sound off on 1": ([cc(64, 127), cc(64, 127, 2)], [cc(120, 0)], (False, True)),
    "all notes off leaves the pedal": ([cc(64, 127), cc(64, 127, 2)], [cc(123, 0)], (True, True)),
}


@pytest.mark.parametrize("patch", ["bars", "voices"])
@pytest.mark.parametrize("name", LEVELS)
def test_the_pedals_of_a_channel_hold_its_notes(bars, tmp_path, name, patch):
    before, after, expected = LEVELS[name]
    if patch == "voices" and "half" in name:
        pytest.skip("voices have no half pedal")
    part = track(*((0, one) for one in before), *PRESSED, *OFFS, *((9, one) for one in after), *TAIL)
    sound = rendered(bars if patch == "bars" else VOICE, smf(part), tmp_path, seconds=1.7)
    for key, held in zip((57, 63), expected, strict=True):
        assert (level(sound, key, 1.5) > HELD) == held and (level(sound, key, 1.5) < ENDED) != held


@pytest.mark.parametrize("pedal", [64, 66])
def test_reset_lifts_the_pedals_of_its_channel(bars, tmp_path, pedal):
    part = [(0, on(57)), (0, cc(pedal, 127)), (480, off(57))]
    for messages, held in (([], True), ([(9, cc(121, 0))], False), ([(9, cc(121, 0, 2))], True)):
        sound = rendered(bars, smf(track(*part, *messages, *TAIL)), tmp_path, seconds=1.7)
        assert (level(sound, 57, 1.5) > HELD) == held


def test_sostenuto_keeps_the_keys_of_its_channel(bars, tmp_path):
    part = track(*PRESSED, (240, cc(66, 127, 2)), *OFFS, *TAIL)
    sound = rendered(bars, smf(part), tmp_path, seconds=1.7)
    assert level(sound, 57, 1.5) < ENDED and level(sound, 63, 1.5) > HELD


def test_a_pedal_of_the_master_holds_the_notes_of_its_zone(bars, tmp_path):
    for channel, held in ((1, True), (3, True), (4, False)):
        notes = [(0, cc(64, 127, channel)), (0, on(57, channel=3)), (480, off(57, channel=3))]
        sound = rendered(bars, smf(track(*rpn(6, (6, 5)), *notes, *TAIL)), tmp_path, seconds=1.7)
        assert (level(sound, 57, 1.5) > HELD) == held


# --- lengths

MODES = [120, 123, 124, 125, 126, 127]


@pytest.mark.parametrize("control", MODES)
def test_a_mode_message_ends_the_keys_of_its_channel(tmp_path, control):
    part = [
        (0, on(60)),
        (0, on(67, channel=2)),
        (480, cc(control, 0)),
        (4800, on(62)),
        (480, off(62)),
        (0, off(67, channel=2)),
    ]
    assert lengths(read(smf(track(*part)), tmp_path)) == [(60, 0.0, 0.5), (67, 0.0, 6.0), (62, 5.5, 0.5)]


ENDS = {
    "pressed twice, let go twice": (
        [(0, on(60)), (240, on(60)), (240, off(60)), (480, off(60))],
        [(60, 0.0, 0.25), (60, 0.25, 0.75)],
    ),
    "pressed three times": (
        [(0, on(60)), (96, on(60)), (96, on(60)), (96, off(60)), (96, off(60)), (96, off(60))],
        [(60, 0.0, 0.1), (60, 0.1, 0.1), (60, 0.2, 0.3)],
    ),
    "on before off at one tick": (
        [(0, on(60)), (480, on(60)), (0, off(60)), (480, off(60))],
        [(60, 0.0, 0.5), (60, 0.5, 0.5)],
    ),
    "velocity 0 after on at one tick": (
        [(0, on(60)), (480, on(60)), (0, on(60, 0)), (480, off(60))],
        [(60, 0.0, 0.5), (60, 0.5, 0.5)],
    ),
    "a chord on one tick": (
        [
            (0, on(60)),
            (0, on(64)),
            (480, on(60)),
            (0, on(64)),
            (0, off(60)),
            (0, off(64)),
            (480, off(60)),
            (0, off(64)),
        ],
        [(60, 0.0, 0.5), (64, 0.0, 0.5), (60, 0.5, 0.5), (64, 0.5, 0.5)],
    ),
    "off, on, and off again at one tick": (
        [(0, on(60)), (480, off(60)), (0, on(60)), (0, off(60)), (480, on(64)), (480, off(64))],
        [(60, 0.0, 0.5), (60, 0.5, 0.0), (64, 1.0, 0.5)],
    ),
    "no length": ([(0, on(60)), (0, off(60)), (480, on(64)), (480, off(64))], [(60, 0.0, 0.0), (64, 0.5, 0.5)]),
    "an off too many": (
        [(0, on(60)), (480, off(60)), (0, off(60)), (480, on(60)), (480, off(60))],
        [(60, 0.0, 0.5), (60, 1.0, 0.5)],
    ),
    "an off of another channel": ([(0, on(60)), (240, off(60, channel=2)), (240, off(60))], [(60, 0.0, 0.5)]),
}


@pytest.mark.parametrize("name", ENDS)
def test_which_note_an_off_ends(tmp_path, name):
    part, expected = ENDS[name]
    assert lengths(read(smf(track(*part)), tmp_path)) == expected


TRACKS = {
    "off on another track": (
        [[(0, on(60))], [(480, off(60)), (4800, on(62)), (480, off(62))]],
        [(60, 0.0, 0.5), (62, 5.5, 0.5)],
    ),
    "off on a track without notes": (
        [[(0, on(60)), (4800, on(62)), (480, off(62))], [(480, off(60))]],
        [(60, 0.0, 0.5), (62, 5.0, 0.5)],
    ),
    "its own track first": (
        [[(0, on(60)), (960, off(60))], [(240, on(60)), (240, off(60))]],
        [(60, 0.0, 1.0), (60, 0.25, 0.25)],
    ),
    "on before off on two tracks at one tick": (
        [[(480, on(60)), (480, off(60))], [(0, on(60)), (480, off(60))]],
        [(60, 0.0, 0.5), (60, 0.5, 0.5)],
    ),
    "off on a third track": (
        [[(0, on(60))], [(0, on(64)), (960, off(64))], [(480, off(60))]],
        [(60, 0.0, 0.5), (64, 0.0, 1.0)],
    ),
}


@pytest.mark.parametrize("name", TRACKS)
def test_which_note_an_off_of_a_track_ends(tmp_path, name):
    parts, expected = TRACKS[name]
    assert lengths(read(smf(*(track(*part) for part in parts)), tmp_path)) == expected


def test_members_of_a_zone_hold_a_key_together(bars, tmp_path):
    """The key is up when the second member lets it go."""
    notes = [(0, on(57, channel=2)), (240, on(57, channel=3)), (240, off(57, channel=2)), (480, off(57, channel=3))]
    played = scene_of_file(engine.load(bars), _saved(tmp_path, smf(track(*rpn(6, (6, 5)), *notes))))
    damped = [event.time for event in played.scene.event if event.kind == "damp" and event.time > 0.0]
    assert damped == pytest.approx([1.0])


def _saved(folder, data):
    (folder / "x.mid").write_bytes(data)
    return folder / "x.mid"


# --- pedals of scores


@pytest.mark.hard_for("guitar-30", "guitar-3", "guitar-0", "guitar-80", "guitar-1")
@pytest.mark.parametrize("ticks", [0, 1, 3, 30, 80])
@pytest.mark.parametrize("patch", ["bars", "guitar"])
def test_a_pedal_that_goes_up_and_down_at_once_damps(bars, tmp_path, ticks, patch):
    """Up and down again within 0 to 83 ms: what was held falls, as far as in a lift of a tenth of a second."""
    path = bars if patch == "bars" else patch
    part = [(0, cc(64, 127)), (0, on(57)), (480, off(57)), (240, cc(64, 0)), (ticks, cc(64, 127)), *TAIL]
    levels = [
        level(rendered(path, smf(track(*part)), tmp_path, Midi(shortest_lift=lift), seconds=1.6), 57, 1.4)
        for lift in (0.0, 0.1)
    ]
    part[4] = (96, cc(64, 127))
    whole = level(rendered(path, smf(track(*part)), tmp_path, Midi(), seconds=1.6), 57, 1.4)
    assert levels[1] == pytest.approx(whole, abs=1.0) and levels[1] < levels[0] - 3.0
    assert levels[1] < -25.0


def pedals(*moves):
    """Moves of the sustain pedal: time, s, and value."""
    return [Note(time, "sustain", 0, value) for time, value in moves]


LIFTS = {
    "at once": ([(0.0, 127), (1.0, 0), (1.003, 127)], [(0.0, 127), (1.0, 0), (1.1, 127)]),
    "at one time": ([(0.0, 127), (1.0, 0), (1.0, 127)], [(0.0, 127), (1.0, 0), (1.1, 127)]),
    "long enough": ([(0.0, 127), (1.0, 0), (1.2, 127)], [(0.0, 127), (1.0, 0), (1.2, 127)]),
    "by steps": (
        [(0.0, 127), (1.0, 30), (1.01, 0), (1.02, 70), (1.03, 127)],
        [(0.0, 127), (1.0, 30), (1.01, 0), (1.1, 70), (1.1, 127)],
    ),
    "half a pedal": ([(0.0, 127), (1.0, 80), (1.003, 127)], [(0.0, 127), (1.0, 80), (1.003, 127)]),
    "down before it was ever up": ([(0.0, 127), (0.003, 100)], [(0.0, 127), (0.003, 100)]),
    "up again before it is down": ([(0.0, 127), (1.0, 0), (1.003, 127), (1.05, 0)], [(0.0, 127), (1.0, 0), (1.05, 0)]),
    "twice": (
        [(0.0, 127), (1.0, 0), (1.003, 127), (1.5, 0), (1.503, 127)],
        [(0.0, 127), (1.0, 0), (1.1, 127), (1.5, 0), (1.6, 127)],
    ),
}


@pytest.mark.parametrize("name", LIFTS)
def test_a_lift_is_as_long_as_the_shortest(name):
    moves, expected = LIFTS[name]
    made = [(round(note.seconds, 6), note.value) for note in delay_pedals(pedals(*moves), 0.1)]
    assert made == expected
    assert delay_pedals(pedals(*moves), 0.0) == pedals(*moves)
