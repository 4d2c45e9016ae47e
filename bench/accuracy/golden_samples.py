"""The samples of one version of the engine: every shipped patch offline, traced and live, in blocks of two sizes.

Run with that version's folder as the first of the Python path: `golden_samples.py PATCHES FOLDER NAME …`. The names
of the engine's edges are the same in all versions; what lies within is looked for where it has been.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np

import engine

OFFLINE, TRACED, LIVE = 1.0, 0.06, 0.2  # s
BLOCKS = 64, 997  # frames
SAMPLERATE = 44_100
OLD = "engine."  # when all modules lay in one folder
VARIANTS: dict[str, list[dict[str, Any]]] = {  # beside the patch as it is
    "repelled_oscillator": [{"scheme": "fdh"}],
    "barrier_quadratic": [{"order": 4, "substeps": 2}],
    "piano_c4": [{"substeps": 2}],
    "guitar_frets": [{"order": 6}],
    "ball_on_drum": [{"oversample": 2}],
}


def first_of(*places: str) -> Any:
    """What lies at the first of some places, `module:name`, that this version has."""
    for place in places:
        module, _, name = place.partition(":")
        try:
            return getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError):
            continue
    raise ImportError(" or ".join(places))


def in_blocks(scene: engine.Scene, size: int) -> np.ndarray:
    """Offline, so many frames at a time."""
    build = first_of("engine.assembly.build:build", "engine.build.build:build", OLD + "build:build")
    simulation = first_of(
        "engine.offline.simulation:Simulation", "engine.offline.simulation:Runner", OLD + "runner:Runner"
    )
    model, state, _ = build(scene, SAMPLERATE)
    running = simulation(model, state)
    advance = getattr(running, "render_block", None) or running.block
    audio = np.zeros((round(TRACED * SAMPLERATE), scene.channels))
    for begin in range(0, len(audio), size):
        advance(audio[begin : begin + size])
    return audio


def live(scene: engine.Scene, size: int) -> np.ndarray:
    """As the audio thread plays it, with a strike on its way."""
    player = first_of("engine.live.player:Player", OLD + "player:Player")(scene, SAMPLERATE, LIVE)
    render = getattr(player, "render_into", None) or player.play
    out = np.zeros((round(LIVE * SAMPLERATE), player.channels), np.float32)
    player.strike(frame=3000)
    for begin in range(0, len(out), size):
        render(out[begin : begin + size])
    return out


def samples(scene: engine.Scene, variants: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """All that is compared, by name."""
    found = {"offline": engine.render(scene, OFFLINE).audio}
    traced = engine.render(scene, TRACED, trace=True)
    assert traced.trace is not None
    found |= {f"trace.{name}": array for name, array in traced.trace.items()}
    for size in BLOCKS:
        found[f"blocks of {size}"] = in_blocks(scene, size)
        found[f"live, {size}"] = live(scene, size)
    for variant in variants:
        told = ", ".join(f"{name} {value}" for name, value in variant.items())
        found[told] = engine.render(scene, OFFLINE, **variant).audio
    return found


def main(patches: Path, folder: Path, names: list[str]) -> None:
    """Write a file for each patch; one that is there already is kept."""
    for name in names:
        if not (path := folder / f"{name}.npz").exists():
            found = samples(engine.load(patches / f"{name}.toml"), VARIANTS.get(name, []))
            np.savez(folder / f".{name}.npz", **found)  # type: ignore[arg-type]
            (folder / f".{name}.npz").rename(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
