"""The sample rates and channel counts that each audio format can hold.

libsndfile does not tell before it writes: OGG above 200 kHz ends in a segmentation fault, and some formats keep another
rate than they are given. The rules below were found by writing each format and reading it back (libsndfile 1.2.2).
"""

from pathlib import Path

MP3_RATES = 8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000  # Hz
STEREO, MONO = ("MP3", "AVR", "MPC2K", "VOC"), ("HTK", "SDS", "SVX", "WVE", "XI")
MAX_FORMAT_CHANNELS = {"FLAC": 8} | dict.fromkeys(STEREO, 2) | dict.fromkeys(MONO, 1)
MAX_FORMAT_RATE = {"OGG": 200_000, "FLAC": 655_350, "MPC2K": 65_535, "SVX": 65_535}  # Hz
FORMAT_RATES = {"MP3": MP3_RATES, "WVE": (8000,), "XI": (44_100,)}  # Hz, the only ones
PERIOD_TICKS = {"HTK": 10**7, "SDS": 10**9}  # per second; these store the period of a sample as a whole number of ticks
COMMON_FORMATS = "WAV", "FLAC", "OGG", "MP3", "AIFF", "CAF"


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
