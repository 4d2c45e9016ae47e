"""Messages of the command line: one line each, on standard error, with the name of the program."""

import json
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.faults import Fault, PatchError, PatchWarning
from engine.output_files import error_reason
from engine.wording import json_safe, program_name

if TYPE_CHECKING:
    from engine.live.midi_files import MidiNotes
    from engine.patch.scene import Scene

CHOOSE_PARTS = "choose parts with --channels or --tracks"  # of a MIDI file
SHORTEST_SILENCE = 0.05  # s, that a note to the user is worth
BODIES_OF_KIND = {  # one and several, where they are not the kind and the kind with an s
    "mass": ("mass", "masses"),
    "air": ("air volume", "air volumes"),
    "modes": ("measured body", "measured bodies"),
}


class CommandError(Exception):
    """A command fails: the message is printed, and the program ends with the code."""

    def __init__(self, message: object, code: int = 1) -> None:
        super().__init__(str(message))
        self.code = code


class InputError(Exception):
    """The input of a command has faults: these are printed, and the program ends with 2."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__(faults)
        self.faults = faults


@contextmanager
def memory_errors_explained(remedy: str) -> Iterator[None]:
    """Within it, a MemoryError becomes a CommandError. remedy: what would need less memory"""
    try:
        yield
    except MemoryError:
        raise CommandError(f"there is not enough memory for so many samples; {remedy}") from None


def write_file(path: Path, write: Callable[[Path], object]) -> None:
    """Let a function write a file. Raises CommandError, which says which file could not be written, and why."""
    try:
        write(path)
    except (OSError, RuntimeError) as error:
        raise CommandError(f"cannot write {path} ({error_reason(error)})") from error


def print_result(as_json: bool, values: Any, print_text: Callable[[], object]) -> None:
    """Print the result of a command: values as JSON, or a text."""
    if as_json:
        print(json.dumps(json_safe(values)))
    else:
        print_text()


def print_messages(lines: Iterable[str]) -> None:
    """Print lines on standard error."""
    for line in lines:
        print(line, file=sys.stderr)


def print_error(message: object) -> None:
    """Print one line with the program's name before it."""
    print(f"{program_name()}: {message}", file=sys.stderr)


def print_faults(faults: Iterable[Fault]) -> None:
    """Print one line for each fault."""
    print_messages(map(str, faults))


@contextmanager
def patch_warnings_as_notes() -> Iterator[None]:
    """Within it, each PatchWarning is one line on standard error, printed once."""
    said: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if not issubclass(category, PatchWarning):
            show_other(message, category, *place, **more)
        elif (note := str(message)) not in said:
            said.add(note)
            print(f"note: {note}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("always", PatchWarning)
        show_other = warnings.showwarning
        warnings.showwarning = show  # restored by catch_warnings
        yield


def read_patch(path: str) -> "tuple[Scene | None, list[Fault]]":
    """Read a patch; returns its scene, or its faults."""
    from engine.patch.scene import load

    try:
        return load(path), []
    except PatchError as error:
        return None, error.faults


def require_scene(scene: "Scene | None", faults: list[Fault]) -> "Scene":
    """Return a scene that was read without faults. Raises InputError if there are some."""
    if scene is None or faults:
        raise InputError(faults)
    return scene


def describe_bodies(scene: "Scene") -> str:
    """Count the bodies of each kind in words, the most frequent kind first, such as 226 strings and 2 plates."""
    counts = Counter(body.kind for body in scene.body).most_common()
    texts = [f"{count} {BODIES_OF_KIND.get(kind, (kind, f'{kind}s'))[count > 1]}" for kind, count in counts]
    return " and ".join(filter(None, (", ".join(texts[:-1]), *texts[-1:])))


def describe_leftover(unknown_keys: list[str], ignored: dict[str, int], stolen: int = 0, refused: int = 0) -> list[str]:
    """Describe the notes and messages that were not played, a line for each reason.

    unknown_keys: that an instrument has not; ignored: messages by what they are
    stolen, refused: notes that ended for others; and notes, or bends, beyond the pitches that there are
    """
    lines = []
    if unknown_keys:
        lines.append(f"notes were ignored, because the instrument does not have these keys: {', '.join(unknown_keys)}")
    if ignored:
        what = ", ".join(f"{kind} ({count})" for kind, count in sorted(ignored.items()))
        lines.append(f"these MIDI messages were ignored: {what}")
    if stolen:
        lines.append(f"{stolen} notes ended early to free a voice for others; give more --voices")
    if refused:
        lines.append(f"{refused} notes or bends were refused, because they are beyond the pitches or keys of the patch")
    return lines


def describe_midi_file(path: str, file: "MidiNotes", remedy: str = CHOOSE_PARTS) -> list[str]:
    """Describe the part of a MIDI file that is played, a line for each thing that a user may not expect.

    remedy: how other parts would be played
    """
    from engine.live.midi_parts import list_parts

    lines = describe_mended_file(path, file.mended)
    if len(file.parts) > 1:
        lines.append(
            f"{path}: {len(file.parts)} parts are played on one instrument: {list_parts(file.parts)}; {remedy}"
        )
    notes = sum(part.notes for part in file.left_out)
    if drums := [part for part in file.left_out if part.is_drums]:
        lines.append(f"{path}: {notes} notes of channel {drums[0].channel}, drums, were left out; {remedy}")
    elif notes:
        parts = list_parts(file.left_out)
        lines.append(f"{path}: {notes} notes were left out that are not drums: {parts}; {remedy}")
    return lines + describe_unknown_drums(file) + describe_leading_silence(path, file.begin)


def describe_mended_file(path: str, mended: str) -> list[str]:
    """Describe what of a broken MIDI file was skipped or clipped. mended: as of engine.live.midi_files.MidiNotes"""
    return [f"{path} is broken, and was mended: {mended}"] if mended else []


def describe_unknown_drums(file: "MidiNotes") -> list[str]:
    """Describe the drums of a MIDI file that a patch does not have."""
    from engine.live.general_midi import drum_name

    names = [f"{drum_name(key)} {count} ×" for key, count in sorted(file.unknown_drums.items()) if count]
    return [f"these drums were left out, because the patch does not have them: {', '.join(names)}"] if names else []


def describe_leading_silence(path: str, seconds: float) -> list[str]:
    """Describe the silence that is left out before the first note of a MIDI file. seconds: its length"""
    return [f"{path}: {seconds:.3g} s of silence before the first note were left out"] * (seconds > SHORTEST_SILENCE)
