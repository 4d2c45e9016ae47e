"""A set of sampled notes as an SFZ file (sfzformat.com): which sample sounds for which keys and velocities."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from engine.instrument.key_names import note_name
from engine.output_files import atomic_write
from engine.wording import to_one_line

MAX_TITLE_CHARACTERS = 80
LOWEST_VELOCITY, HIGHEST_VELOCITY = 1, 127


class Sample(NamedTuple):
    """A sampled note."""

    key: int
    velocity: int
    file: str


def nearest_ranges(values: Sequence[int], lowest: int, highest: int) -> dict[int, tuple[int, int]]:
    """For each of some values that go upwards, the first and last numbers that are nearest to it; all together are the
    numbers from `lowest` to `highest`, each once."""
    middles = [(a + b) // 2 for a, b in pairwise(values)]
    begins, ends = [lowest, *(middle + 1 for middle in middles)], [*middles, highest]
    return {value: (begin, end) for value, begin, end in zip(values, begins, ends, strict=True)}


def format_sfz(title: str, samples: Sequence[Sample], release: Mapping[int, float], is_loop: bool = False) -> str:
    """The text of the file: a group for each sampled key, with a region for each of its velocities.

    release: how long notes of each key go on when it is let go, s
    is_loop: samples repeat without a seam
    """
    velocities: dict[int, dict[int, str]] = {}
    for sample in sorted(samples):
        velocities.setdefault(sample.key, {})[sample.velocity] = sample.file
    keys = sorted(velocities)
    counts = f"{len(samples)} samples of {len(keys)} keys; their levels are those of the velocities"
    lines = [f"// {to_one_line(title, MAX_TITLE_CHARACTERS)}: {counts}"]
    mode = "loop_continuous" if is_loop else "no_loop"
    lines += ["", "<control>", "note_offset=0", "", "<global>", f"loop_mode={mode}", "amp_veltrack=0"]
    for key, (low, high) in nearest_ranges(keys, keys[0], keys[-1]).items():
        lines += ["", f"<group> // {note_name(key)}", f"lokey={low} hikey={high} pitch_keycenter={key}"]
        lines.append(f"ampeg_release={release[key]:.3g}")
        layers = nearest_ranges(list(velocities[key]), LOWEST_VELOCITY, HIGHEST_VELOCITY)
        for velocity, (soft, loud) in layers.items():
            lines.append(f"<region> sample={velocities[key][velocity]} lovel={soft} hivel={loud}")
    return "\n".join(lines) + "\n"


def write_sfz(
    path: Path, title: str, samples: Sequence[Sample], release: Mapping[int, float], is_loop: bool = False
) -> None:
    """Write the file. Raises OSError."""
    with atomic_write(path) as temporary:
        temporary.write_text(format_sfz(title, samples, release, is_loop), "utf-8")
