"""Files of a render: each is written beside its target, then renamed, so that none is ever half-written."""

import io
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.formats import unheld

if TYPE_CHECKING:
    import numpy as np

LOUDNESS = -1.0  # dBFS, peak of a normalised file
LARGEST = 3e38, 1e308  # that single and double precision hold
SILENCE = 1e-30  # a smaller peak is not worth normalising
SUBTYPES = ("FLOAT", "PCM_24", "PCM_16", "DOUBLE")


def amplified(
    audio: "np.ndarray", peak: float, gain: float | None, subtype: str | None = None
) -> "tuple[np.ndarray, float]":
    """The audio at the level of the file, and its gain in dB; normalised if none is given, and no larger than what a
    file of floating point holds."""
    import numpy as np

    if gain is None:
        gain = LOUDNESS - 20 * math.log10(peak) if peak > SILENCE else 0.0
    elif peak > 0.0:
        gain = min(gain, math.floor(20 * (math.log10(LARGEST[subtype == "DOUBLE"]) - math.log10(peak))))
    return np.asarray(audio * 10 ** (gain / 20)), gain


def lowered(output: Path, gain: float, asked: float | None) -> list[str]:
    """That a gain was lowered to what a file holds, if it was."""
    if asked is None or gain >= asked:
        return []
    return [f"{output}: --gain {asked:g} is more than its numbers hold; {gain:g} dB instead"]


def save_audio(output: Path, audio: "np.ndarray", samplerate: int, subtype: str | None) -> None:
    """Write samples [frames, channels]; the format is that of the file's name."""
    import soundfile

    kind = output.suffix.lstrip(".").upper()
    if what := unheld(output, samplerate, audio.shape[1] if audio.ndim > 1 else 1):
        raise RuntimeError(what)
    with replaced(output) as path, Written(path, "w+") as file:
        try:
            soundfile.write(file, audio, samplerate, format=kind, subtype=subtype_of(output, subtype))
        except (RuntimeError, AssertionError):
            if file.fault is None:
                raise
        if file.fault is not None:
            raise file.fault


class Written(io.FileIO):
    """A file that keeps what went wrong: libsndfile says no more of it than "System error", and of a full disk under
    OGG and MP3 nothing at all."""

    fault: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it."""
        done = 0
        try:
            while done < len(data):
                done += super().write(data[done:])
        except OSError as error:
            self.fault = error
        return done


def save_trace(output: Path, trace: "dict[str, np.ndarray]") -> None:
    """Write the arrays of a trace."""
    import numpy as np

    with replaced(output) as path, open(path, "wb") as file:
        np.savez(file, **trace)  # type: ignore[arg-type]


def plain(text: str) -> str:
    """A text with names of files, as UTF-8 can hold it, though a name be no text."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def writable(folder: Path) -> bool:
    """Whether a file can be made in a folder; tried, for what permissions say is not always so."""
    import tempfile

    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def absolute(path: Path) -> Path:
    """The whole path; as it is if the folder one is in was removed."""
    try:
        return path.absolute()
    except FileNotFoundError:
        return path


def reason(error: Exception) -> str:
    """Why a file could not be written or read, in few words."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    if isinstance(error, UnicodeDecodeError):
        return "not a text file"
    return getattr(error, "error_string", "") or str(error)  # of soundfile: without the file beside the target


def encoded(path: Path) -> Any:
    """A path as soundfile takes it: bytes if the name is no text."""
    try:
        str(path).encode(sys.getfilesystemencoding())
    except UnicodeEncodeError:
        return os.fsencode(path)
    return path


@dataclass(frozen=True)
class Clipped:
    """Samples beyond what a file can hold."""

    count: int
    total: int
    fits: float  # dB, the largest gain at which all fit

    def __str__(self) -> str:
        return f"{self.count} of {self.total} samples are beyond ±1 and clipped; --gain {self.fits:.1f} fits"


def clipped(output: Path, audio: "np.ndarray", gain: float, subtype: str | None) -> Clipped | None:
    """What a file of integers cuts off of audio at a gain in dB; FLOAT and DOUBLE hold everything."""
    import soundfile

    kind = subtype_of(output, subtype) or soundfile.default_subtype(output.suffix.lstrip("."))
    beyond = int((abs(audio) > 1.0).sum())
    if not beyond or kind in ("FLOAT", "DOUBLE"):
        return None
    return Clipped(beyond, audio.size, fitting(gain, float(abs(audio).max())))


def fitting(gain: float, peak: float) -> float:
    """The largest gain, to a tenth of a dB, at which what peaks so high at this gain stays within ±1."""
    return math.floor(10 * (gain - 20 * math.log10(peak))) / 10


def part_of(target: Path) -> Path:
    """The file that is to be written first; if this process is killed, `engine.leftovers` finds it."""
    return target.with_name(f".{target.name}.{os.getpid()}.part")


def free(path: Path) -> Path:
    """The path, or one with a number at the end of its name that no file has."""
    number, found = 2, path
    while os.path.lexists(found):
        number, found = number + 1, path.with_name(f"{path.stem}_{number}{path.suffix}")
    return found


@contextmanager
def replaced(target: Path) -> Iterator[Path]:
    """A temporary file beside the target, which takes its place when all is written."""
    path = part_of(target)
    try:
        yield path
        os.replace(path, target)
    finally:
        path.unlink(missing_ok=True)


def subtype_of(output: Path, asked: str | None) -> str | None:
    """The sample format asked for; else FLOAT where a WAV is written, and the format's own elsewhere."""
    return asked or ("FLOAT" if output.suffix.lower() == ".wav" else None)
