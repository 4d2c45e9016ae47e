"""The comparison of the notes of a MIDI file with each note alone."""

from pathlib import Path

import mido
import pytest

from bench.accuracy import notes
from engine.live.instrument_notes import PlayedFile, scene_of_file

TICKS = 480  # a beat, of half a second


def save(path: Path, *parts: list[tuple[float, str, int, int]]) -> Path:
    """Save parts of a file, each a list of messages: time (s), note_on, note_off or pedal, key or controller, value."""
    file = mido.MidiFile(ticks_per_beat=TICKS)
    for channel, part in enumerate(parts):
        track, now = mido.MidiTrack(), 0
        for seconds, kind, number, value in part:
            ticks = round(seconds * 2 * TICKS)
            if kind == "pedal":
                track.append(mido.Message("control_change", control=number, value=value, time=ticks - now))
            else:
                track.append(mido.Message(kind, channel=channel, note=number, velocity=value, time=ticks - now))
            now = ticks
        file.tracks.append(track)
    file.save(path)
    return path


def note(key: int, begin: float, end: float, velocity: int = 90) -> list[tuple[float, str, int, int]]:
    """Return the messages of a note."""
    return [(begin, "note_on", key, velocity), (end, "note_off", key, 64)]


def played_by(name: str, path: Path) -> tuple[notes.Instrument, PlayedFile]:
    """Return an instrument, and a file as it plays it."""
    instrument = notes.Instrument(name)
    return instrument, scene_of_file(instrument.scene, path)


FILES = {
    "two parts hold a key": [note(67, 0.0, 1.0), note(67, 0.5, 2.0)],
    "a key is pressed again": [[*note(67, 0.0, 0.5), *note(67, 0.5, 0.5), *note(69, 0.5, 0.8)]],
    "many at once": [note(key, 0.01 * n, 1.0) for n, key in enumerate(range(56, 80, 2))],
    "pedals": [
        [(0.0, "pedal", 64, 127), *note(67, 0.1, 0.3), (0.5, "pedal", 64, 60), *note(69, 0.6, 0.7)],
        [(0.0, "pedal", 67, 127), *note(60, 0.2, 0.9), (1.0, "pedal", 67, 0)],
        [(0.05, "note_on", 72, 80), (0.06, "pedal", 66, 127), (0.4, "note_off", 72, 64), (0.8, "pedal", 66, 0)],
    ],
}


@pytest.mark.parametrize("case", FILES)
@pytest.mark.parametrize("name", ["vibraphone", "violin", "guitar"])
def test_all_events_of_a_note_alone_are_in_its_file(name: str, case: str, tmp_path: Path) -> None:
    instrument, played = played_by(name, save(tmp_path / "notes.mid", *FILES[case]))
    assert not list(notes.compare_events(instrument, played, instrument.notes_of(played)))
    counts = instrument.counts
    assert counts.notes == len(played.score.notes) and counts.events > 3 * counts.notes
    assert counts.misses == counts.unexplained == 0


def test_an_event_that_is_missing_is_found_and_so_is_one_too_many(tmp_path: Path) -> None:
    instrument, played = played_by(
        "vibraphone", save(tmp_path / "notes.mid", [*note(67, 0.0, 0.4), *note(69, 0.5, 0.8)])
    )
    events = played.scene.event
    strike = next(event for event in events if event.kind == "strike" and event.time == 0.5)
    damp = next(event for event in events if event.kind == "damp" and event.time == pytest.approx(0.4))
    later = strike.model_copy(update={"time": 0.501})
    wrong = [event for event in events if event not in (strike, damp)] + [later]
    changed = played._replace(scene=played.scene.model_copy(update={"event": wrong}))
    texts = list(notes.compare_events(instrument, changed, instrument.notes_of(played)))
    assert (instrument.counts.misses, instrument.counts.unexplained) == (2, 1)
    assert all(any(word in text for text in texts) for word in ("missing at 0.5000", "missing at 0.4000", "of no note"))


def test_notes_end_as_the_keyboard_lets_them(tmp_path: Path) -> None:
    parts = [[*note(60, 0.0, 1.0)], [*note(60, 0.25, 0.5)], [*note(64, 0.0, 2.0), *note(65, 2.5, 3.0)]]
    instrument, played = played_by("guitar", save(tmp_path / "notes.mid", *parts, note(67, 1.0, 1.25)))
    found = [(n.key, n.end, n.ended_by) for n in instrument.notes_of(played)]
    expected = [(60, 0.25, "pressed again"), (64, 1.0, "let go"), (60, 1.0, "let go"), (67, 1.25, "let go")]
    assert found == [*expected, (65, 3.0, "let go")]


def test_levels_differ_where_the_body_still_vibrates_and_only_there(tmp_path: Path) -> None:
    messages = [*note(77, 0.0, 0.4), *note(77, 0.4, 0.6, 50), *note(60, 0.7, 1.0)]
    instrument, played = played_by("vibraphone", save(tmp_path / "notes.mid", messages))
    first, again, other = instrument.levels.compare(played.scene, instrument.notes_of(played), 40)
    assert abs(first.off) < 0.01 and first.before < -200.0
    assert abs(again.off) > 0.1 and again.before > notes.SOUNDING
    assert abs(other.off) < 0.01 and other.before < notes.SOUNDING and other.change is None


def test_a_player_gives_the_samples_of_a_rendering(tmp_path: Path) -> None:
    instrument, played = played_by("violin", save(tmp_path / "notes.mid", note(67, 0.0, 0.2)))
    notes.compare_playing(instrument.counts, played.scene.model_copy(update={"seconds": 0.3}))
    assert (instrument.counts.samples, instrument.counts.differing, instrument.counts.dropped) == (
        2 * 13230,
        0,
        0,
    )  # of two channels
