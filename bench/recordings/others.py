"""Instruments beside sampled ones: those of a free sound font of General MIDI, FluidR3, and of others.

The sampled notes are recorded, but looped after about half a second and faded by the font: only that much is compared.
"""

import sys
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import engine
from bench.publish.report import publish
from bench.recordings.distances import NoteResult, compare_note
from bench.recordings.keys import layer_velocity
from bench.recordings.note import Note, retune
from bench.recordings.peers import DRUM_CHANNEL, FONTS, PlayNote, find_fonts, play_font
from bench.recordings.summary import mean_of
from engine.patch.note_scene import scene_of_note

RATE = 44_100  # Hz
SECONDS, LAYERS = 0.5, (7, 12, 15)
RECORDED = next(name for name in FONTS if name.startswith("FluidR3"))
POWER_KIT = 16  # another recorded one
OURS, NEIGHBOUR = "ours", "recorded neighbour, retuned"
MEASURES = {"third octaves": "bands", "in three windows": "windows", "of the attack": "attack"}


class Instrument(NamedTuple):
    """An instrument, and the sampled one that it is held to."""

    patch: str
    program: int  # of General MIDI, from 0; of drums the kit
    keys: tuple[int, ...]  # of a patch without a keyboard the one that it sounds as it begins
    neighbour: int  # semitones to the key whose sound, retuned, shows natural variation; of drums the kit that does
    channel: int = 0

    @property
    def step(self) -> int:
        """Semitones to the neighbour."""
        return 0 if self.channel == DRUM_CHANNEL else self.neighbour


INSTRUMENTS = (
    Instrument("marimba_keys", 12, (48, 55, 62, 69, 76), 5),
    Instrument("vibraphone", 11, (53, 60, 67, 74, 81), 5),
    Instrument("kalimba_keys", 108, (60, 64, 67, 72, 76), 5),
    Instrument("guitar", 24, (40, 45, 52, 59, 64), 5),
    Instrument("sitar", 104, (48, 53, 55, 60, 67), 5),
    Instrument("violin", 40, (55, 62, 69, 76, 83), 5),
    Instrument("bass_frets", 33, (43,), 5),
    Instrument("slack_bass", 33, (43,), 5),
    Instrument("snare", 0, (38, 40), POWER_KIT, DRUM_CHANNEL),
    Instrument("toms", 0, (41, 43, 45, 47, 48, 50), POWER_KIT, DRUM_CHANNEL),
)


@cache
def load(patch: str) -> engine.Scene:
    """A shipped instrument."""
    return engine.load(patch)


def render_note(patch: str, key: int, layer: int) -> Note:
    """A key, struck and held; or the beginning of a patch without keys."""
    scene = load(patch)
    if scene.instrument is not None:
        scene = scene_of_note(scene, key, layer_velocity(layer), SECONDS + 1.0, SECONDS)
    return Note((engine.render(scene, SECONDS, RATE).audio, RATE), key)


def compare_instrument(of: Instrument, fonts: dict[str, PlayNote], natural: PlayNote) -> Iterator[NoteResult]:
    """Compare each key and layer with the recorded one. natural: plays its neighbour"""

    def note(play: PlayNote, key: int, layer: int) -> Note:
        sound = play(key, layer)
        assert sound is not None
        return Note(sound, key)

    for key in of.keys:
        for layer in LAYERS:
            recorded = note(fonts[RECORDED], key, layer)
            sources = {OURS: render_note(of.patch, key, layer)}
            neighbour = retune(note(natural, key + of.step, layer), key)
            sources[NEIGHBOUR] = Note((neighbour.audio[: recorded.audio.shape[0]], neighbour.rate), key)
            sources |= {font: note(play, key, layer) for font, play in fonts.items() if font != RECORDED}
            for source, sound in sources.items():
                yield compare_note(source, layer, sound, recorded, with_decay=False)


def run(names: list[str]) -> int:
    """Compare the instruments of some patches, all if none is named; print and write the table of all."""
    if RECORDED not in find_fonts():
        print("bench: fluidsynth or its sound font FluidR3 is not there", file=sys.stderr)
        return 2
    chosen = [of for of in INSTRUMENTS if not names or of.patch in names]
    header, rows = ["dB", "keys × layers"], list[list[str]]()
    for of in chosen:
        keys = sorted({*of.keys, *(key + of.step for key in of.keys)})
        notes = [(key, layer, SECONDS) for key in keys for layer in LAYERS]
        with TemporaryDirectory() as folder:
            play = partial(play_font, notes=notes, folder=Path(folder), channel=of.channel)
            fonts = {name: play(font, program=of.program) for name, font in find_fonts().items()}
            is_kit = of.channel == DRUM_CHANNEL
            natural = play(find_fonts()[RECORDED], program=of.neighbour) if is_kit else fonts[RECORDED]
            results = list(compare_instrument(of, fonts, natural))
        sources = list(dict.fromkeys(r.source for r in results))
        header = ["dB", "keys × layers", *sources]
        for name, measure in MEASURES.items():
            means = [mean_of(getattr(r, measure) for r in results if r.source == source) for source in sources]
            row = [f"{of.patch}: {name}", f"{len(of.keys)} × {len(LAYERS)}", *(f"{mean:.1f}" for mean in means)]
            print(*row, sep=" | ", file=sys.stderr)
            rows.append(row)
    if not names:
        publish("recordings_others", header, rows, "recordings")
    return 0
