"""The form of a sound in its file, and presets of it for programs that take such files."""

from dataclasses import dataclass, replace
from typing import NamedTuple

RANGES = {"loudness": (-70.0, 0.0), "loop": (1e-3, 60.0)}  # LUFS; s


@dataclass(frozen=True)
class SoundForm:
    """The form of a sound in its file.

    subtype:  FLOAT, PCM_24, PCM_16 or DOUBLE; that of the file's format if None
    gain:     dB on SI units; the sound is normalised if neither a gain nor a loudness is given
    loudness: LUFS (ITU-R BS.1770), with no peak above -1 dBFS
    trim:     it begins and ends where it is 70 dB below its peak
    fade:     out, over 5 ms, where it is cut; None: unless a gain is given, which keeps all samples
    loop:     s: it repeats without a seam, as its end is cross-faded with its begin
    dither:   triangular noise before samples are rounded to 16 or 24 bits

    Raises ValueError for values out of range, or such that exclude each other.

    >>> import fdh
    >>> fdh.SoundForm(trim=True, loudness=-23.0).fades
    True
    """

    subtype: str | None = None
    gain: float | None = None
    loudness: float | None = None
    trim: bool = False
    fade: bool | None = None
    loop: float | None = None
    dither: bool = False

    def __post_init__(self) -> None:
        if self.gain is not None and self.loudness is not None:
            raise ValueError("gain and loudness are both given; give one of them")
        if self.trim and self.loop is not None:
            raise ValueError("a sound that repeats cannot be trimmed; leave out trim or loop")
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name} = {value!r} is out of range; give {low:g} to {high:g}")

    @property
    def fades(self) -> bool:
        """True if a sound that is cut fades out."""
        return self.gain is None if self.fade is None else self.fade

    @property
    def has_own_level(self) -> bool:
        """True if the level of a sound depends on no other sound."""
        return self.gain is not None or self.loudness is not None


PLAIN_FORM = SoundForm()


class Preset(NamedTuple):
    """Sounds as a program takes them."""

    samplerate: int  # Hz
    subtype: str
    trim: bool
    dither: bool


# what their manuals name: Unity and Unreal Engine play 16 bits (Unreal converts all else when it imports), Wwise
# converts from 24 bits at 48 kHz, REAPER mixes in floating point
PRESETS = {
    "unity": Preset(48_000, "PCM_16", True, True),
    "unreal": Preset(48_000, "PCM_16", True, True),
    "wwise": Preset(48_000, "PCM_24", True, True),
    "reaper": Preset(48_000, "FLOAT", False, False),
}


def with_preset(form: SoundForm, name: str) -> SoundForm:
    """Return a form with what a preset says where the form says nothing."""
    preset = PRESETS[name]
    trim = form.trim or (preset.trim and form.loop is None)
    dither = form.dither or (preset.dither and form.subtype in (None, preset.subtype))
    return replace(form, subtype=form.subtype or preset.subtype, trim=trim, dither=dither)
