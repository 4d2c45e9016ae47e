"""One note of an instrument, as a scene."""

from engine.instrument.expansion import expand_for_score, keys_of, parse_key_of
from engine.instrument.score import PlayedNote, make_score
from engine.patch.scene import Scene

HOLD_SECONDS = 4.0  # how long the key is held if nothing is said
TAIL_SECONDS = 1.0
UNKNOWN_RELEASE = 64


def scene_of_note(
    scene: Scene, key: str | int, velocity: int = 80, hold: float = HOLD_SECONDS, seconds: float | None = None
) -> Scene:
    """The scene in which an instrument plays one note.

    key:     its name, such as "C4", or its MIDI number
    hold:    how long the key is down, s
    seconds: how long it sounds; a second more than it is held if None
    Raises ValueError if the scene is not an instrument or has no such key, PatchError if the patch has an error
    at that key.
    """
    document = scene.instrument
    if document is None:
        raise ValueError("the patch is not an instrument; an instrument has a [keyboard]")
    number = parse_key_of(document, str(key))
    length = hold + TAIL_SECONDS if seconds is None else seconds
    score = make_score([PlayedNote(0.0, number, velocity, hold, UNKNOWN_RELEASE)])
    return scene.with_expansion(expand_for_score(document | {"seconds": length}, score))


def check_all_keys(scene: Scene) -> None:
    """Raise PatchError if an instrument has an error at a key, pressed as softly or as hard as can be."""
    document = scene.instrument
    if document is None:
        return
    seconds = document.get("seconds")
    document = document | {"seconds": None if seconds is None else max(seconds, TAIL_SECONDS)}
    for velocity in (1, 127):
        notes = [PlayedNote(0.0, key, velocity, 0.1, UNKNOWN_RELEASE) for key in keys_of(document["keyboard"])]
        scene.with_expansion(expand_for_score(document, make_score(notes)))
