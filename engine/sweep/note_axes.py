"""Notes and their velocities as axes of a sweep: a set of samples of an instrument."""

from itertools import pairwise

from engine.faults import Fault, PatchError
from engine.instrument.expansion import keys_of
from engine.instrument.key_names import RANGE_SEPARATOR, describe_keys, note_name, parse_key, parse_keys
from engine.instrument.tables import DEFAULT_VELOCITY
from engine.patch.note_scene import scene_of_note
from engine.patch.scene import Scene
from engine.sweep.axes import SweepAxis

NOTE, VELOCITY = "note", "velocity"  # the columns of the index, and the paths of the axes
OPTIONS = {NOTE: "--notes", VELOCITY: "--velocities"}
FULL_VELOCITY = 127
NOTE_FORMS = "give a range such as A0..C8, A0..C8/3 for every third key, or keys such as C2,F#3,A4"
VELOCITY_FORMS = "give a number of layers, such as 8, or velocities from 1 to 127, such as 40,80,127"
MAX_KEYS_NAMED = 8  # in a message
RELEASE_DECAY = 8.0  # players of SFZ let a note fall by e^-8 (69 dB, ARIA) or e^-9 (78 dB, sfizz) in its release


def parse_notes(text: str, scene: Scene, left_out: list[str] | None = None) -> SweepAxis:
    """Make an axis of the notes that --notes lists, upwards; of a range, those that the instrument has.

    left_out: where to add a line of the keys of ranges that it does not have
    Raises ValueError, whose message is one line, also for a key that is named and not there.
    """
    words = [(word, _parse_word(word)) for word in text.split(",")]
    keys = sorted({key for _, listed in words for key in listed})
    if scene.instrument is None:
        _check_pitched(scene)
        return SweepAxis(NOTE, (), tuple(map(note_name, keys)))
    known = keys_of(scene.instrument["keyboard"])
    named = {key for word, listed in words for key in listed if RANGE_SEPARATOR not in word}
    missing = [key for key in keys if key not in known]
    if not_there := [key for key in missing if key in named or len(missing) == len(keys)]:
        raise ValueError(f"the instrument has no key {_list_keys(not_there)}; {describe_keys(known)}")
    if missing and left_out is not None:
        left_out.append(f"notes: the instrument has no key {_list_keys(missing)}, which are left out")
    return SweepAxis(NOTE, (), tuple(note_name(key) for key in keys if key in known))


def _list_keys(keys: list[int]) -> str:
    """The names of keys; of many, the first."""
    rest = f" and {len(keys) - MAX_KEYS_NAMED} more" if len(keys) > MAX_KEYS_NAMED else ""
    return ", ".join(map(note_name, keys[:MAX_KEYS_NAMED])) + rest


def _check_pitched(scene: Scene) -> None:
    """Raise ValueError if nothing in a patch without a keyboard can be tuned to notes."""
    from engine.live.midi_drivers import MidiError
    from engine.live.voice_allocator import pitched_bodies  # which imports Numba

    try:
        pitched_bodies(scene)
    except MidiError as error:
        raise ValueError(f"{error}, or an instrument: a patch with a [keyboard]") from None


def _parse_word(word: str) -> list[int]:
    """The keys of a range with or without a step, or one key. Both ends of a range are taken, whatever the step."""
    text, slash, step = (part.strip() for part in word.partition("/"))
    if not text or (slash and (not step.isdecimal() or int(step) < 1 or ".." not in text)):
        raise ValueError(f'"{word.strip()}" is neither a key nor a range; {NOTE_FORMS}')
    keys = parse_keys(text)
    return [*keys[:: int(step or 1)], keys[-1]]


def parse_velocities(text: str | None) -> SweepAxis:
    """Make an axis of the velocities that --velocities gives: a number of layers, whose top is 127, or a list; one of
    ordinary velocity if it is None. Raises ValueError."""
    if text is None:
        return SweepAxis(VELOCITY, (), (DEFAULT_VELOCITY,))
    words = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() and 1 <= int(word) <= FULL_VELOCITY for word in words):
        raise ValueError(f'"{text}" is neither a number of layers nor a list of velocities; {VELOCITY_FORMS}')
    numbers = sorted(map(int, words))
    if len(numbers) == 1:
        numbers = [round(FULL_VELOCITY * layer / numbers[0]) for layer in range(1, numbers[0] + 1)]
    if twice := [a for a, b in pairwise(numbers) if a == b]:
        raise ValueError(f"{twice[0]} is listed twice; {VELOCITY_FORMS}")
    return SweepAxis(VELOCITY, (), tuple(numbers))


def scene_with_note(scene: Scene, note: str, velocity: int, hold: float, seconds: float) -> Scene:
    """The scene of one note: of an instrument; or of a patch without a keyboard, as one of its voices plays it.

    hold: how long the key is down, s; seconds: how long the scene is
    Raises PatchError.
    """
    try:
        if scene.instrument is not None:
            return scene_of_note(scene, note, velocity, hold, seconds)
        from engine.live.voice_scene import scene_of_voice  # which imports Numba

        return scene_of_voice(scene, parse_key(note), velocity, hold, seconds)
    except PatchError:
        raise
    except ValueError as error:
        raise PatchError([Fault("", str(error))]) from None


def release_time(scene: Scene, hold: float) -> float:
    """Return the release of a note in SFZ, s: players then let it fall at the rate of its dampers. It is as long as the
    scene where it has none."""
    rates = [event.sigma for event in scene.event if event.kind == "damp" and event.time == hold]
    return RELEASE_DECAY / min(rates) if rates else scene.seconds
