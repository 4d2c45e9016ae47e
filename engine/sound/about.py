"""Descriptions of sounds in their files: the chunks of a WAV (LIST, bext, iXML, smpl, cue). Nothing in them depends on
the time or the machine, so that equal sounds are equal files."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

from engine.output_files import to_utf8_text
from engine.provenance import ENGINE, version_of

BEXT_VERSION = 1
DESCRIPTION_BYTES, ORIGINATOR_BYTES = 256, 32
FORWARD = 0  # type of a loop
MAX_COMMENT = 2000  # characters, of a tag
MAX_BYTES = (1 << 32) - 1  # of a RIFF file


@dataclass(frozen=True)
class Marker:
    """A named time in a sound."""

    seconds: float
    name: str


@dataclass(frozen=True)
class About:
    """The description of a sound in its file."""

    title: str = ""
    patch: str = ""  # name of its file
    text: str = ""  # of the patch
    values: Mapping[str, str] = field(default_factory=dict)  # of parameters that another patch has otherwise
    kernel: str = ""
    key: int | None = None  # MIDI number of the note that it is
    tempo: float | None = None  # quarter notes per minute
    markers: tuple[Marker, ...] = ()
    author: str = ""
    licence: str = ""

    def __post_init__(self) -> None:
        """Names and values come from files and words of a command, which may be any bytes."""
        texts = {name: to_utf8_text(getattr(self, name)) for name in ("title", "author", "licence", "patch", "text")}
        values = {to_utf8_text(key): to_utf8_text(value) for key, value in self.values.items()}
        for name, clean in {**texts, "values": values}.items():
            object.__setattr__(self, name, clean)

    @property
    def comment(self) -> str:
        """The patch and its values, in a line."""
        return "; ".join([f"patch {self.patch}"] * bool(self.patch) + [f"{k} = {v}" for k, v in self.values.items()])

    @property
    def tags(self) -> dict[str, str]:
        """The description as files other than WAV have it: by the names of soundfile."""
        comment = f"{self.comment[:MAX_COMMENT]}; kernel {self.kernel}" if self.kernel else self.comment[:MAX_COMMENT]
        return {
            "title": self.title,
            "artist": self.author,
            "license": self.licence,
            "software": program(),
            "comment": comment,
        }


def program() -> str:
    """Return the name of this program, with its version."""
    return f"fdh {version_of(ENGINE)}"


def add_chunks(path: Path, about: About, samplerate: int, shape: tuple[int, int], is_loop: bool) -> None:
    """Add the description of its sound to a finished WAV file. Nothing is added to a file of another kind, or to
    one that would exceed 4 GiB. Raises OSError. shape: frames and channels of the sound"""
    chunks = b"".join(_chunk(name, data) for name, data in list_chunks(about, samplerate, shape, is_loop))
    with path.open("r+b") as file:
        begin = file.read(12)
        end = file.seek(0, 2)
        pad = bytes(end % 2)
        if begin[:4] != b"RIFF" or begin[8:] != b"WAVE" or end + len(pad) + len(chunks) > MAX_BYTES:
            return
        file.write(pad + chunks)
        file.seek(4)
        file.write(struct.pack("<I", end + len(pad) + len(chunks) - 8))


def is_whole(path: Path) -> bool:
    """True if a file is as long as its header says, or is no RIFF file. Raises OSError."""
    with path.open("rb") as file:
        begin = file.read(8)
        return begin[:4] != b"RIFF" or struct.unpack("<I", begin[4:])[0] + 8 == file.seek(0, 2)


def list_chunks(about: About, samplerate: int, shape: tuple[int, int], is_loop: bool) -> list[tuple[bytes, bytes]]:
    """Return the names and contents of the chunks that describe a sound."""
    frames, channels = shape
    info = {b"INAM": about.title, b"IART": about.author, b"ICOP": about.licence}
    info |= {b"ISFT": program(), b"ICMT": about.comment}
    chunks = [
        (b"LIST", b"INFO" + b"".join(_chunk(name, _text(value)) for name, value in info.items() if value)),
        (b"bext", _broadcast_extension(about)),
        (b"iXML", _ixml(about, channels).encode()),
    ]
    if about.key is not None or is_loop:
        chunks.append((b"smpl", _sampler(about.key, samplerate, frames, is_loop)))
    return chunks + _markers(about.markers, samplerate)


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)


def _text(value: str) -> bytes:
    return value.encode() + b"\0"


def _fixed(value: str, size: int) -> bytes:
    """A text in so many bytes."""
    return value.encode()[:size].decode("utf-8", "ignore").encode().ljust(size, b"\0")


def _broadcast_extension(about: About) -> bytes:
    """The extension of broadcasters (EBU Tech 3285), without a date and a time."""
    description = " - ".join(part for part in (about.title, about.comment) if part)
    texts = _fixed(description, DESCRIPTION_BYTES) + _fixed(program(), ORIGINATOR_BYTES) + bytes(ORIGINATOR_BYTES + 18)
    return texts + struct.pack("<QH", 0, BEXT_VERSION) + bytes(254) + _text(f"A=PCM,T={program()}\r\n")


def _ixml(about: About, channels: int) -> str:
    """The same as XML (iXML 2.10), and the whole patch."""
    values = {"FDH_VERSION": version_of(ENGINE), "FDH_KERNEL": about.kernel, "FDH_PATCH_FILE": about.patch}
    parts = [f"<{name}>{escape(value)}</{name}>" for name, value in values.items() if value]
    parts += [f'<FDH_VALUE NAME="{_attribute(k)}">{escape(v)}</FDH_VALUE>' for k, v in about.values.items()]
    if about.tempo is not None:
        parts.append(f"<FDH_TEMPO>{about.tempo:.9g}</FDH_TEMPO>")
    parts += [f"<FDH_PATCH>{_xml_text(about.text)}</FDH_PATCH>"] * bool(about.text)
    tracks = "".join(
        f"<TRACK><CHANNEL_INDEX>{n}</CHANNEL_INDEX><INTERLEAVE_INDEX>{n}</INTERLEAVE_INDEX></TRACK>"
        for n in range(1, channels + 1)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<BWFXML><IXML_VERSION>2.10</IXML_VERSION>'
        f"<PROJECT>{_xml_text(about.title)}</PROJECT><NOTE>{_xml_text(about.comment)}</NOTE>"
        f"<USER>{''.join(parts)}</USER>"
        f"<TRACK_LIST><TRACK_COUNT>{channels}</TRACK_COUNT>{tracks}</TRACK_LIST></BWFXML>\n"
    )


def _xml_text(text: str) -> str:
    """A text in XML, without the characters that XML has not."""
    return escape("".join(one for one in text if one in "\t\n" or one >= " "))


def _attribute(text: str) -> str:
    return escape(text, {'"': "&quot;"})


def _sampler(key: int | None, samplerate: int, frames: int, is_loop: bool) -> bytes:
    """The chunk for samplers: the key at which a sound has its own pitch, and its loop."""
    nanoseconds = round(1e9 / samplerate)
    head = struct.pack("<9I", 0, 0, nanoseconds, 60 if key is None else key, 0, 0, 0, int(is_loop), 0)
    return head + (struct.pack("<6I", 0, FORWARD, 0, frames - 1, 0, 0) if is_loop else b"")


def _markers(markers: tuple[Marker, ...], samplerate: int) -> list[tuple[bytes, bytes]]:
    if not markers:
        return []
    places = [round(marker.seconds * samplerate) for marker in markers]
    cues = b"".join(struct.pack("<II4sIII", n, p, b"data", 0, 0, p) for n, p in enumerate(places, 1))
    labels = (_chunk(b"labl", struct.pack("<I", n) + _text(marker.name)) for n, marker in enumerate(markers, 1))
    return [(b"cue ", struct.pack("<I", len(markers)) + cues), (b"LIST", b"adtl" + b"".join(labels))]
