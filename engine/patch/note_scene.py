"""One note of an instrument, as a scene."""

from pydantic import ValidationError

from engine.faults import Fault, PatchError
from engine.instrument.expansion import expand_for_score, parse_key_of
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
    try:
        return scene.with_expansion(expand_for_score(document | {"seconds": length}, score))
    except ValidationError as error:
        raise PatchError([Fault("", e["msg"]) for e in error.errors(include_url=False)]) from None
