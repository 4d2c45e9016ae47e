"""Audio formats: what each can hold, and how libsndfile writes them: in pieces, in a form that can grow, and without
the time of day.

libsndfile does not tell before it writes: OGG above 200 kHz ends in a segmentation fault, and some formats keep another
rate than they are given. The rules below were found by writing each format and reading it back (libsndfile 1.2.2).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

MP3_RATES = 8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000  # Hz
STEREO, MONO = ("MP3", "AVR", "MPC2K", "VOC"), ("HTK", "SDS", "SVX", "WVE", "XI")
MAX_FORMAT_CHANNELS = {"FLAC": 8} | dict.fromkeys(STEREO, 2) | dict.fromkeys(MONO, 1)
MAX_FORMAT_RATE = {"OGG": 200_000, "FLAC": 655_350, "MPC2K": 65_535, "SVX": 65_535}  # Hz
FORMAT_RATES = {"MP3": MP3_RATES, "WVE": (8000,), "XI": (44_100,)}  # Hz, the only ones
PERIOD_TICKS = {"HTK": 10**7, "SDS": 10**9}  # per second; these store the period of a sample as a whole number of ticks
COMMON_FORMATS = "WAV", "FLAC", "OGG", "MP3", "AIFF", "CAF"
PIECE_FRAMES = 8192  # of one write: libvorbis takes 4 bytes of stack a frame, and a thread may have 512 kB
ADD_PEAK_CHUNK, RF64_AUTO_DOWNGRADE, UPDATE_HEADER = 0x1050, 0x1210, 0x1061  # commands of libsndfile
TAGGED_FORMATS = "FLAC", "OGG", "MP3", "AIFF", "CAF"  # whose texts libsndfile writes
LARGE_FORMATS = ("RF64", "W64", "CAF", "FLAC", "OGG", "MP3", "RAW")  # hold more than 4 GiB
MAX_BYTES = (1 << 32) - (1 << 16)  # of a file of another format
MAX_HEADER_BYTES = 120  # of an RF64, before its samples
OGG_SERIAL = 1  # of the only stream in a file; libsndfile takes it from the clock
OGG_POLYNOMIAL = 0x04C11DB7  # of the check sum of a page: CRC-32, most significant bit first
MAT5_TEXT_BYTES = 116  # at the start of a MAT5 file, with the time at which it was written


def explain_unsupported_format(output: Path, samplerate: int, channels: int) -> str:
    """Why a file of this name cannot hold such audio, and which could; "" if it can."""
    name = output.suffix.lstrip(".").upper()
    limit = _describe_limit(name, samplerate, channels)
    if not limit:
        return ""
    suitable = [f".{other.lower()}" for other in COMMON_FORMATS if not _describe_limit(other, samplerate, channels)]
    return f"{name} files {limit}; {', '.join(suitable)} would hold {samplerate} Hz and {channels} channels"


def _describe_limit(name: str, samplerate: int, channels: int) -> str:
    """The limit of a format that such audio exceeds; "" if there is none."""
    if name == "SD2":
        return "have a second file beside them"
    if channels > (most := MAX_FORMAT_CHANNELS.get(name, channels)):
        return f"hold {most} channel{'s' if most > 1 else ''} at most, and the sound has {channels}"
    if samplerate > (highest := MAX_FORMAT_RATE.get(name, samplerate)):
        return f"hold {highest} Hz at most, and the sound has {samplerate}"
    if name == "FLAC" and samplerate > 65_535 and samplerate % 10:
        return f"hold rates above 65535 Hz in tens of Hz, and the sound has {samplerate}"
    if samplerate not in FORMAT_RATES.get(name, (samplerate,)):
        return f"hold {', '.join(map(str, FORMAT_RATES[name]))} Hz only, and the sound has {samplerate}"
    if name in PERIOD_TICKS and int(PERIOD_TICKS[name] / (PERIOD_TICKS[name] // samplerate)) != samplerate:
        return f"hold no rate of {samplerate} Hz exactly"
    return ""


def open_sound_file(
    file: Any, samplerate: int, channels: int, subtype: str | None, kind: str, grows: bool = False
) -> Any:
    """Open a sound file of soundfile for writing. Raises RuntimeError, TypeError or ValueError if libsndfile refuses.

    file:  a binary file
    kind:  its format
    grows: it is a good file at any time, and a WAV becomes RF64 beyond 4 GiB
    """
    import soundfile

    sound = soundfile.SoundFile(
        file, "w", samplerate, channels, subtype, format="RF64" if grows and kind == "WAV" else kind
    )
    if grows:
        _command(sound, RF64_AUTO_DOWNGRADE, 1)
    else:
        _command(sound, ADD_PEAK_CHUNK, 0)  # it has the time, so that no two files would be equal
    return sound


def keep_header_written(sound: Any) -> None:
    """Let libsndfile write the header of an open sound file anew at each write, so that one that is broken off is a
    good one."""
    _command(sound, UPDATE_HEADER, 1)


def _command(sound: Any, command: int, value: int) -> None:
    """Set an option of libsndfile; where soundfile does not show its inner parts, it stays as it is."""
    import soundfile

    try:
        send, null = soundfile._snd.sf_command, soundfile._ffi.NULL
    except AttributeError:
        return
    send(sound._file, command, null, value)


def write_pieces(sound: Any, samples: "np.ndarray") -> None:
    """Write samples [frames, channels] to an open sound file. Raises what soundfile raises."""
    for begin in range(0, len(samples), PIECE_FRAMES):
        sound.write(samples[begin : begin + PIECE_FRAMES])


def format_for_size(kind: str, size: int) -> str:
    """The format in which a sound of so many bytes is written: a WAV of more than 4 GiB is RF64, which players know by
    the same name. Raises RuntimeError if the format holds no such sound."""
    if size <= MAX_BYTES or kind in LARGE_FORMATS:
        return kind
    if kind == "WAV":
        return "RF64"
    raise RuntimeError(f"{kind} files hold 4 GiB at most; .wav, .w64, .caf, .flac would hold the sound")


def write_tags(sound: Any, kind: str, tags: Mapping[str, str]) -> None:
    """Write what there is to say of a sound (title, software, comment) into its file, before its samples, if files of
    its format hold texts. sound: of soundfile; kind: its format"""
    if kind in TAGGED_FORMATS:
        for name, text in tags.items():
            if text:
                setattr(sound, name, text)


def remove_time(file: Any, kind: str) -> None:
    """Take out of a finished file what libsndfile has written of the time of day, so that equal sounds are equal files.

    file: binary, open for reading and writing
    """
    if kind == "MAT5":
        file.seek(0)
        file.write(b"MATLAB 5.0 MAT-file, written by libsndfile\0".ljust(MAT5_TEXT_BYTES))
    elif kind == "OGG":
        _number_pages(file)
    elif kind == "RF64":  # whose PEAK chunk cannot be left out
        file.seek(0)
        if (at := file.read(MAX_HEADER_BYTES).find(b"PEAK")) > 0:
            file.seek(at + 12)
            file.write(bytes(4))


def _number_pages(file: Any) -> None:
    """Give the pages of an Ogg file OGG_SERIAL. A check sum is linear: it changes by that of what changes."""
    at = 0
    while True:
        file.seek(at)
        head = file.read(27)
        if len(head) < 27 or head[:4] != b"OggS":
            return
        size = 27 + head[26] + sum(file.read(head[26]))
        change = head[14:18], OGG_SERIAL.to_bytes(4, "little")
        difference = int.from_bytes(bytes(a ^ b for a, b in zip(*change, strict=True)), "big")
        check = int.from_bytes(head[22:26], "little") ^ _check_sum(difference, size - 18)
        file.seek(at + 14)
        file.write(change[1] + head[18:22] + check.to_bytes(4, "little"))
        at += size


def _check_sum(number: int, zeros: int) -> int:
    """The check sum of a number of 32 bits that so many bytes of zeros follow: its product with a power of x, modulo
    the polynomial."""
    result, factor, bits = number, 2, 8 * zeros + 32
    while bits:
        if bits & 1:
            result = _multiply(result, factor)
        factor, bits = _multiply(factor, factor), bits >> 1
    return result


def _multiply(a: int, b: int) -> int:
    """The product of two polynomials over GF(2), modulo the one of Ogg."""
    product = 0
    while b:
        if b & 1:
            product ^= a
        a = (a << 1) ^ ((1 << 32 | OGG_POLYNOMIAL) if a >> 31 else 0)
        b >>= 1
    return product
