"""How far a string that drives a board one way is from one that rides on it, and what each costs."""

import numpy as np

import engine
from bench.performance.turns import Replay, time_in_turn
from bench.publish.report import pin, publish
from bench.recordings.measure import band_levels, difference

RATE = 44_100
SECONDS = 2.5
PITCH = 261.6256  # Hz
BOARDS = {"guitar top, 0.3 kg": ([0.5, 0.4], 1.5, 12.0), "piano, 9 kg": ([1.4, 0.9], 7.14, 1000.0)}
BOARDS |= {"piano, four times as heavy, 36 kg": ([1.4, 0.9], 28.6, 16_000.0)}  # size, m; density, kg/m²; rigidity, N·m


def scene_of(size: list[float], density: float, rigidity: float, one_way: bool) -> engine.Scene:
    """A C4 string, struck, that ends on a board."""
    string = {"name": "string", "kind": "string", "length": 0.62, "mass": 3.93e-3, "frequency": PITCH}
    string |= {"inharmonicity": 3.77e-4, "decay": {"kind": "linear", "a": 0.3, "b": 1.5e-3}}
    board = {
        "name": "board",
        "kind": "plate",
        "size": size,
        "area_density": density,
        "flexural_rigidity": rigidity,
        "modes": 261,
    }
    board |= {"decay": {"kind": "loss_factor", "eta": 0.02}}
    hammer = {"name": "hammer", "kind": "mass", "mass": 2.97e-3, "displacement": -1e-3, "velocity": 2.5}
    end = {"kind": "end", "body": "string", "at": 1.0, "on": "board", "on_at": [0.36, 0.31], "one_way": one_way}
    felt = {"body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5, "loss": 0.02}
    parts = {"connection": [end], "contact": [felt], "pickup": [{"body": "board", "at": [0.3, 0.6]}]}
    return engine.Scene.model_validate({"body": [string, board, hammer], "seconds": SECONDS} | parts)


def many_strings(count: int, one_way: bool) -> engine.Scene:
    """So many strings, a semitone apart, pulled aside at once, on one board; each ends at a place of its own."""
    table = scene_of(*BOARDS["piano, 9 kg"], one_way).model_dump(exclude_unset=True)
    string, board = table["body"][:2]
    begin = {"kind": "triangle", "at": 0.12, "amplitude": 1e-3}
    pitches = {f"string{n}": PITCH * 2 ** ((n - count / 2) / 12) for n in range(count)}
    strings = [string | {"name": name, "frequency": f, "displacement": begin} for name, f in pitches.items()]
    ends = [table["connection"][0] | {"body": s, "on_at": [0.2 + 0.01 * n, 0.31]} for n, s in enumerate(pitches)]
    return engine.Scene.model_validate(table | {"body": [*strings, board], "connection": ends, "contact": []})


def decay_of_first(audio: np.ndarray) -> float:
    """Slope of the first partial from 0.1 to 1.5 s, dB/s."""
    size, starts = 8192, np.arange(round(0.1 * RATE), round(1.5 * RATE) - 8192, 1024)
    wave = np.hanning(size) * np.exp(-2j * np.pi * PITCH * np.arange(size) / RATE)
    level = 20 * np.log10([abs(audio[s : s + size] @ wave) for s in starts])
    return float(np.polyfit(starts / RATE, level, 1)[0])


def run() -> None:
    """Measure, print and write the table."""
    pin()
    rows = []
    for name, board in BOARDS.items():
        scenes = [scene_of(*board, one_way) for one_way in (False, True)]
        both, one = (engine.render(scene).audio for scene in scenes)
        apart = difference(band_levels(one, RATE), band_levels(both, RATE))[0]
        slopes = [f"{decay_of_first(audio[:, 0]):.1f}" for audio in (both, one)]
        rows.append([name, f"{apart:.1f}", *slopes])
    decays = [f"decay of the first partial, dB/s: {way}" for way in ("two-way", "one-way")]
    publish("one_way", ["board", "difference, dB", *decays], rows)
    rows = []
    for strings in (1, 12, 60):
        replays = (Replay(many_strings(strings, one_way), 0.5, metered=True) for one_way in (False, True))
        rows.append([f"{strings}", *(taken.nanoseconds for taken in time_in_turn(*replays, turns=5))])
    publish("one_way_cost", ["strings", "ns per sample, two-way", "ns per sample, one-way"], rows, "one_way")
