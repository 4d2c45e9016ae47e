"""Which sample rates and how many channels an audio format holds.

libsndfile does not tell before it writes: OGG above 200 kHz ends in a segmentation fault, and some formats keep another
rate than they are given. The rules below were found by writing each format and reading it back (libsndfile 1.2.2).
"""

from pathlib import Path

MP3 = 8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000  # Hz
CHANNELS = {"FLAC": 8, "MP3": 2, "AVR": 2, "MPC2K": 2, "VOC": 2, "HTK": 1, "SDS": 1, "SVX": 1, "WVE": 1, "XI": 1}
HIGHEST = {"OGG": 200_000, "FLAC": 655_350, "MPC2K": 65_535, "SVX": 65_535}  # Hz
ONLY = {"MP3": MP3, "WVE": (8000,), "XI": (44_100,)}  # Hz
PERIODS = {"HTK": 10**7, "SDS": 10**9}  # these keep a whole number of such parts of a second
COMMON = "WAV", "FLAC", "OGG", "MP3", "AIFF", "CAF"


def unheld(output: Path, samplerate: int, channels: int) -> str:
    """Why a file of this name cannot hold such sound, and which could; nothing if it can."""
    kind = output.suffix.lstrip(".").upper()
    why = _why(kind, samplerate, channels)
    if not why:
        return ""
    others = [f".{other.lower()}" for other in COMMON if not _why(other, samplerate, channels)]
    return f"{kind} files {why}; {', '.join(others)} would hold {samplerate} Hz and {channels} channels"


def _why(kind: str, samplerate: int, channels: int) -> str:
    """What a format does not hold."""
    if kind == "SD2":
        return "have a second file beside them"
    if channels > (most := CHANNELS.get(kind, channels)):
        return f"hold {most} channel{'s' if most > 1 else ''} at most, and the sound has {channels}"
    if samplerate > (highest := HIGHEST.get(kind, samplerate)):
        return f"hold {highest} Hz at most, and the sound has {samplerate}"
    if kind == "FLAC" and samplerate > 65_535 and samplerate % 10:
        return f"hold rates above 65535 Hz in tens of Hz, and the sound has {samplerate}"
    if samplerate not in ONLY.get(kind, (samplerate,)):
        return f"hold {', '.join(map(str, ONLY[kind]))} Hz only, and the sound has {samplerate}"
    if kind in PERIODS and int(PERIODS[kind] / (PERIODS[kind] // samplerate)) != samplerate:
        return f"hold no rate of {samplerate} Hz exactly"
    return ""
