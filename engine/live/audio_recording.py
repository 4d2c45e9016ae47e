"""A recording of live sound: it grows beside its target, and takes its name at the end, whatever happens meanwhile."""

import math
import shutil
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from engine.audio_formats import LARGE_FORMATS, MAX_BYTES, keep_header_written, open_sound_file, write_pieces
from engine.output_files import (
    atomic_write,
    error_reason,
    replace_file,
    resolve_links,
    resolve_subtype,
    round_samples,
    soundfile_path,
    temporary_path,
    unused_path,
)
from engine.wording import program_name

if TYPE_CHECKING:
    import numpy as np

FINAL_HEADER_FORMATS = ("FLAC", "OGG", "MP3")  # these cannot have their header written anew while they grow


class RecordingFile:
    """A file as libsndfile asks for it. An error is kept and not raised: it would come up in the midst of C."""

    def __init__(self, path: Path) -> None:
        self.file: BinaryIO = open(path, "w+b", buffering=0)  # noqa: SIM115
        self.error: OSError | None = None
        self.size = 0  # bytes
        lock_file(self.file)

    def write(self, data: bytes) -> int:
        """Write as much as can be; returns how many bytes."""
        done = 0
        try:
            while done < len(data):
                done += self.file.write(data[done:])
        except OSError as error:
            self.error = self.error or error
        self.size = max(self.size, self.file.tell())
        return done

    def read(self, size: int) -> bytes:
        return self.file.read(size)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self.file.seek(offset, whence)

    def tell(self) -> int:
        return self.file.tell()


def lock_file(file: BinaryIO) -> bool:
    """Mark an open file as being written, for as long as it is open; False if another process has done so. Windows
    does not let a file be renamed while it is open, and needs no mark."""
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


class NoRecording:
    """Takes the place of a recording if none is wanted."""

    def __init__(self) -> None:
        self.lines, self.is_complete = list[str](), True

    def write(self, samples: "np.ndarray") -> None:
        """Nothing."""


class Recording:
    """Samples go to a file as they come. Once one cannot be written, no more are, and what was written is kept.

    lines: what is to be said at the end
    is_complete: whether the file is complete and has its final name
    Raises OSError.
    """

    def __init__(self, target: Path, samplerate: int, channels: int, subtype: str | None) -> None:
        self.target, self.samplerate, self.subtype = resolve_links(target), samplerate, subtype
        self.temporary, self.lines, self.is_complete, self.frames = temporary_path(self.target), list[str](), True, 0
        kind = target.suffix.lstrip(".").upper()
        self.tape = RecordingFile(self.temporary)
        try:
            self.file = open_sound_file(
                self.tape, samplerate, channels, resolve_subtype(target, subtype), kind, grows=True
            )
        except (RuntimeError, TypeError, ValueError) as error:
            self._drop()
            raise OSError(f"{target}: {error_reason(error)}") from error
        self._most = math.inf if kind == "WAV" or kind in LARGE_FORMATS else MAX_BYTES
        if kind not in FINAL_HEADER_FORMATS:
            keep_header_written(self.file)

    def write(self, samples: "np.ndarray") -> None:
        """Write more samples [frames, channels]."""
        if not self.is_complete:
            return
        reason = ""
        if self.tape.size + samples.nbytes > self._most:
            self._break_off(f"{self.target.suffix.lstrip('.').upper()} files hold 4 GiB")
            return
        try:
            write_pieces(self.file, round_samples(samples, self.target, self.subtype))
        except (AssertionError, OSError, RuntimeError) as error:  # soundfile asserts that all was written
            reason = error_reason(error) or "it cannot be written"
        if reason or self.tape.error is not None:
            self._break_off(error_reason(self.tape.error) if self.tape.error is not None else reason)
        else:
            self.frames += len(samples)

    def _break_off(self, reason: str) -> None:
        self.is_complete = False
        message = f"{self.target}: recording ended after {self.frames / self.samplerate:.1f} s ({reason})"
        print(
            f"{program_name()}: {message}; playing continues, and the file keeps what was recorded so far",
            file=sys.stderr,
        )

    def close(self, wanted: bool = True) -> None:
        """Give the file its name; wanted: also if nothing was recorded."""
        with suppress(OSError, RuntimeError):
            self.file.close()
        if self.is_complete and self.tape.error is not None:
            self._break_off(error_reason(self.tape.error))
        if not self.frames and not wanted:
            self._drop()
            return
        repair_header(self.temporary)
        if sys.platform == "win32":  # an open file cannot be renamed there
            self.tape.file.close()
        try:
            self._name()
        finally:
            self.tape.file.close()

    def _drop(self) -> None:
        self.tape.file.close()
        self.temporary.unlink(missing_ok=True)

    def _name(self) -> None:
        try:
            replace_file(self.temporary, self.target)
        except (FileNotFoundError, NotADirectoryError):
            self._rescue()
        except OSError as error:
            self.is_complete = False
            self.lines.append(
                f"{self.target} cannot be written ({error_reason(error)}); the recording is kept as {self.temporary}"
            )

    def _rescue(self) -> None:
        """Copy the open file, whose folder was removed, to where it was to be, or to the temporary folder."""
        for folder in (self.target.parent, Path(tempfile.gettempdir())):
            try:
                folder.mkdir(parents=True, exist_ok=True)
                place = unused_path(folder / self.target.name)
                with atomic_write(place) as part, part.open("wb") as copy:
                    self.tape.seek(0)
                    shutil.copyfileobj(self.tape.file, copy)
            except (OSError, ValueError):
                continue
            self.is_complete = self.is_complete and place == self.target
            self.lines.append(
                f"{self.target.parent} was removed during the recording; the recording is kept as {place}"
            )
            return
        self.is_complete = False
        self.lines.append(f"{self.target.parent} was removed during the recording; the recording is lost")


def readable_frames(path: Path) -> int:
    """Frames of an audio file that can be read, even if it was broken off; 0 if it is none."""
    return _count_frames(path)[0]


def repair_header(path: Path) -> int:
    """Count the frames of an audio file that can be read, and write the number into a FLAC file that lacks it."""
    count, unknown = _count_frames(path)
    if unknown and count:
        with suppress(OSError), path.open("r+b") as file:
            if file.read(4) == b"fLaC":
                file.seek(18)  # rate, channels and bits, then 36 bits for the number of frames
                head = int.from_bytes(file.read(8), "big")
                file.seek(18)
                file.write((head >> 36 << 36 | count).to_bytes(8, "big"))
    return count


def _count_frames(path: Path) -> tuple[int, bool]:
    """Frames that can be read, and whether the file itself does not say how many."""
    import soundfile

    count, block = 0, 4096
    try:
        with soundfile.SoundFile(soundfile_path(path)) as file:
            if file.frames < 1 << 40:
                return int(file.frames), False
            while got := len(file.read(block, "float32")):
                count += got
    except (OSError, RuntimeError, TypeError):  # the end, where it was broken off
        pass
    return count, True
