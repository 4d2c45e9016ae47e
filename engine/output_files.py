"""Files of a rendering. Each is written under another name, then renamed, so that none is ever half-written."""

import io
import math
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from engine.audio_formats import (
    explain_unsupported_format,
    format_for_size,
    open_sound_file,
    remove_time,
    write_pieces,
    write_tags,
)
from engine.faults import Fault

if TYPE_CHECKING:
    import numpy as np

NORMALISED_PEAK_DBFS = -1.0
MAX_SAMPLE_VALUE = 3e38, 1e308  # of single and of double precision
SILENT_PEAK = 1e-30  # audio with a smaller peak counts as silent, and is not normalised
SUBTYPES = ("FLOAT", "PCM_24", "PCM_16", "DOUBLE")
BITS = {"PCM_16": 16, "PCM_24": 24}  # of formats whose samples libsndfile would floor
BITS_OF_SUBTYPE = BITS | {"FLOAT": 32, "DOUBLE": 64, "PCM_32": 32, "PCM_S8": 8, "PCM_U8": 8}  # of uncompressed samples
ROUNDED_FRAMES = 1 << 20  # at a time
TRACE_ENDINGS = ".npz", ".nc", ".mat", ".csv"
DITHER_SEED = 0  # equal sounds are equal files
MAX_NAME_BYTES = 255  # of a file, on all usual file systems


def apply_gain(
    audio: "np.ndarray", peak: float, gain: float | None, subtype: str | None = None
) -> "tuple[np.ndarray, float]":
    """Bring audio to the level of its file. Returns it with the gain that was applied, dB.

    audio: [frames, channels]
    peak:  its largest absolute value
    gain:  dB; the audio is normalised if it is None. It is lowered to what samples in floating point can hold.
    """
    import numpy as np

    if gain is None:
        gain = NORMALISED_PEAK_DBFS - 20 * math.log10(peak) if peak > SILENT_PEAK else 0.0
    elif peak > 0.0:
        gain = min(gain, math.floor(20 * (math.log10(MAX_SAMPLE_VALUE[subtype == "DOUBLE"]) - math.log10(peak))))
    return np.asarray(audio * 10 ** (gain / 20)), gain


def describe_lowered_gain(output: Path, gain: float, requested: float | None) -> list[str]:
    """A message that the requested gain was lowered, in a list; an empty list if it was not."""
    if requested is None or gain >= requested:
        return []
    return [f"{output}: a gain of {requested:g} dB exceeds the range of its numbers; {gain:g} dB was used instead"]


class Description(NamedTuple):
    """Description of a sound in its file."""

    tags: Mapping[str, str]  # of formats other than WAV
    finish: Callable[[Path], None]  # adds the rest to a finished file, before it has its name


def save_audio(
    output: Path,
    audio: "np.ndarray",
    samplerate: int,
    subtype: str | None,
    dither: bool = False,
    description: Description | None = None,
) -> None:
    """Write audio [frames, channels] to a file, in the format of its name.

    dither: add triangular noise before samples are rounded

    Raises OSError if it cannot be written, RuntimeError if the format cannot hold it.
    """
    import numpy as np

    kind, channels = output.suffix.lstrip(".").upper(), audio.shape[1] if audio.ndim > 1 else 1
    if message := explain_unsupported_format(output, samplerate, channels):
        raise RuntimeError(message)
    chosen, bits = resolve_subtype(output, subtype), BITS_OF_SUBTYPE.get(subtype_of_file(output, subtype), 0)
    written = format_for_size(kind, audio.size * bits // 8)
    noise = np.random.default_rng(DITHER_SEED) if dither else None
    with atomic_write(output) as path:
        with ErrorKeepingFile(path, "w+") as file:
            try:
                with open_sound_file(file, samplerate, channels, chosen, written) as sound:
                    write_tags(sound, written, description.tags if description else {})
                    for begin in range(0, len(audio), ROUNDED_FRAMES):
                        piece = audio[begin : begin + ROUNDED_FRAMES]
                        write_pieces(sound, round_samples(piece, output, subtype, noise))
                remove_time(file, written)
            except (RuntimeError, AssertionError):
                if file.error is None:
                    raise
            if file.error is not None:
                raise file.error
        if description is not None:
            description.finish(path)


def round_samples(
    audio: "np.ndarray", output: Path, subtype: str | None, noise: "np.random.Generator | None" = None
) -> "np.ndarray":
    """Return audio [frames, channels] as soundfile is to write it: in a file of 16 or 24 bits, integers that are the
    nearest ones, with what is beyond full scale cut off; libsndfile takes those below, which shifts a sound by half a
    step. Of other files, the audio itself. subtype: as requested; noise: of a dither, a step to either side at most,
    which makes the error of rounding a noise that does not depend on the sound"""
    import numpy as np

    bits = BITS.get(subtype_of_file(output, subtype))
    if bits is None:
        return audio
    full = float(1 << (bits - 1))
    scaled = np.multiply(audio, full)
    if noise is not None:
        scaled += noise.random(scaled.shape) - noise.random(scaled.shape)
    np.clip(np.rint(scaled, out=scaled), -full, full - 1.0, out=scaled)
    return np.asarray(scaled.astype(np.int16) if bits == 16 else scaled.astype(np.int32) << (32 - bits))


class ErrorKeepingFile(io.FileIO):
    """A file that keeps the error of a write. libsndfile calls it "System error", and with OGG and MP3 on a full disk
    says nothing at all."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all bytes, and return how many were written."""
        count = 0
        try:
            while count < len(data):
                count += super().write(data[count:])
        except OSError as error:
            self.error = error
        return count


def save_trace(output: Path, trace: Mapping[str, object]) -> None:
    """Write the arrays of a trace to an .npz file. Raises OSError."""
    import numpy as np

    with atomic_write(output) as path, open(path, "wb") as file:
        np.savez(file, **trace)  # type: ignore[arg-type]


def write_text(output: Path, text: str) -> None:
    """Write a text to a file, as UTF-8. Raises OSError."""
    with atomic_write(output) as path:
        path.write_text(text, "utf-8")


def to_utf8_text(text: str) -> str:
    """The text with U+FFFD for what UTF-8 cannot hold: names of files may be any bytes."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def is_writable_folder(folder: Path) -> bool:
    """True if a file can be made in a folder. It is tried, because permissions do not always show it."""
    import tempfile

    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def absolute_path(path: Path) -> Path:
    """The absolute path, or the path as it is if the current folder was removed."""
    try:
        return path.absolute()
    except FileNotFoundError:
        return path


def error_reason(error: Exception) -> str:
    """Why a file could not be read or written, in a few words."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror[0].lower() + error.strerror[1:]
    if isinstance(error, UnicodeDecodeError):
        return "not a text file"
    return getattr(error, "error_string", "") or str(error)  # of soundfile: the name it adds is the temporary one


def soundfile_path(path: str | Path) -> Any:
    """The path in the form that soundfile takes: bytes if the name is no text."""
    try:
        str(path).encode(sys.getfilesystemencoding())
    except UnicodeEncodeError:
        return os.fsencode(path)
    return path


@dataclass(frozen=True)
class Clipping:
    """Samples that a file of integers cuts off."""

    count: int
    total: int
    safe_gain: float  # dB, the largest at which none is cut off

    def __str__(self) -> str:
        return f"{self.count} of {self.total} samples are beyond ±1 and clipped; --gain {self.safe_gain:.1f} fits"


def count_clipped(output: Path, audio: "np.ndarray", gain: float, subtype: str | None) -> Clipping | None:
    """Count the samples that a file of integers cuts off; None if there are none, or the file holds floating point.

    audio: [frames, channels], at the level of the file; gain: dB, which brought it there
    """
    count = int((abs(audio) > 1.0).sum())
    if not count or subtype_of_file(output, subtype) in ("FLOAT", "DOUBLE"):
        return None
    return Clipping(count, audio.size, largest_safe_gain(gain, float(abs(audio).max())))


def largest_safe_gain(gain: float, peak: float) -> float:
    """The largest gain, dB in tenths, that keeps audio within ±1 whose peak at a given gain (dB) is `peak`."""
    return math.floor(10 * (gain - 20 * math.log10(peak))) / 10


def temporary_path(target: Path) -> Path:
    """The name under which a file is written. If this process is killed, `engine.live.recovery` finds it."""
    ending, name = f".{os.getpid()}.part", target.name
    if (excess := len(os.fsencode(f".{name}{ending}")) - MAX_NAME_BYTES) > 0:
        stem = os.fsencode(target.stem)[:-excess].decode("utf-8", "ignore")
        name = f"{stem}{target.suffix}"
    return target.with_name(f".{name}{ending}")


def resolve_links(path: Path) -> Path:
    """The absolute path of what a path leads to through all links, which need not be there."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):  # the current folder was removed
        return absolute_path(path)


def is_stream(path: Path) -> bool:
    """True if a path leads to a named pipe or a device, which takes bytes in order and has no temporary name."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def explain_unwritable(path: Path) -> str:
    """Why what stands at a path cannot be written anew, in a few words; "" if it can, or nothing stands there."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return ""
    except OSError as error:
        return error_reason(error)
    if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)):
        return "not a file, but a folder, a disk or a socket"
    return "" if mode & 0o222 and os.access(path, os.W_OK) else "read-only"


def unused_path(path: Path) -> Path:
    """The path, or the same with a number at the end of its name, whichever no file has."""
    number, unused = 2, path
    while os.path.lexists(unused):
        number, unused = number + 1, path.with_name(f"{path.stem}_{number}{path.suffix}")
    return unused


@contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """Give a temporary path beside the target, and rename it to the target when all is written. Links are followed, and
    a file keeps its mode. A pipe or a device is sent what was written. Raises OSError, also if the target is
    read-only; or if the path cannot be renamed, as on Windows while a player has the target open: what was written is
    kept, and named."""
    if reason := explain_unwritable(target):
        raise OSError(reason)
    if is_stream(target):
        with _sent_to(target) as path:
            yield path
        return
    target = resolve_links(target)
    path = temporary_path(target)
    try:
        yield path
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    try:
        replace_file(path, target)
    except OSError as error:
        if not path.exists():
            raise
        kept = _rename_to_unused(path, target)
        raise OSError(error.errno, f"{error.strerror or error}; what was written is in {kept.name}") from error


def _rename_to_unused(path: Path, target: Path) -> Path:
    """Rename a file to a name like that of the target; return the name that it has then."""
    kept = unused_path(target)
    try:
        os.rename(path, kept)
    except OSError:
        return path
    return kept


def replace_file(path: Path, target: Path) -> None:
    """Rename a file to the target, which keeps the mode of what it takes the name of. Raises OSError."""
    if target.is_file():
        shutil.copymode(target, path)
    os.replace(path, target)


@contextmanager
def _sent_to(target: Path) -> Iterator[Path]:
    """Give a path in the temporary folder, and send what was written there to a pipe or a device."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part"
        yield path
        with path.open("rb") as file, target.open("wb") as stream:
            shutil.copyfileobj(file, stream)


def resolve_subtype(output: Path, requested: str | None) -> str | None:
    """The requested sample format, or else FLOAT for a WAV; None leaves it to the file format."""
    return requested or ("FLOAT" if output.suffix.lower() == ".wav" else None)


def subtype_of_file(output: Path, requested: str | None) -> str:
    """The sample format that a file will have: the requested one, or else that of its file format."""
    import soundfile

    return str(resolve_subtype(output, requested) or soundfile.default_subtype(output.suffix.lstrip(".")))


def check_audio_format(output: Path, subtype: str | None, option: str) -> list[Fault]:
    """List the faults of the format of an audio file that is to be written.

    option: the one that names the file
    """
    import soundfile

    kind = output.suffix.lstrip(".").upper()
    if kind not in soundfile.available_formats():
        return [Fault(option, f'"{output.name}" is not the name of a known audio format; end it in .wav')]
    if subtype is not None and subtype not in SUBTYPES:
        return [Fault("--subtype", f'unknown sample format "{subtype}"; {", ".join(SUBTYPES)}')]
    if not soundfile.check_format(kind, resolve_subtype(output, subtype)):
        if subtype is None:
            return [
                Fault(
                    "--subtype", f"{kind} files do not store their sample format; give --subtype FLOAT, or write a .wav"
                )
            ]
        return [Fault("--subtype", f"{kind} files cannot hold {subtype}; write a .wav")]
    return []
