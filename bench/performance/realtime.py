"""How fast each shipped patch runs, once compiled: on one core and on two, in blocks of several sizes, with its energy
error beside it; and how near its worst block comes to a deadline."""

import ctypes
import time
from collections.abc import Callable
from timeit import timeit

import numpy as np

import engine
from bench.publish.report import ROOT, pin, publish
from engine.assembly.build import build
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation
from engine.offline.statistics import newton_statistics

RATE = 44_100
BLOCKS = (64, 256, 1024)
RUNS = 7
TURNS = 3
WARM = 0.05  # s, after which a state is saved
SECONDS = 1.0  # from there


def measure(scene: engine.Scene, size: int, cores: int = 1, metered: bool = True) -> tuple[np.ndarray, Simulation]:
    """Seconds of each block [runs, blocks], every run from the same warm state."""
    model, state, _ = build(scene, RATE)
    simulation = Simulation(model, state, cores, metered)
    out = np.zeros((size, scene.channels))
    for _ in range(max(1, round(WARM * RATE / size))):
        simulation.render_block(out)
    saved = [(array, array.copy()) for array in arrays_of(state)]
    times = np.zeros((RUNS, round(SECONDS * RATE / size)))
    for run in times:
        for array, copy in saved:
            array[...] = copy
        for n in range(run.size):
            begin = time.perf_counter()
            simulation.render_block(out)
            run[n] = time.perf_counter() - begin
    return times, simulation


def cost_of_measuring(scene: engine.Scene) -> float:
    """How many times as long blocks take whose energies are measured: of runs in turn, the least of either."""
    least = [np.inf, np.inf]
    for _ in range(TURNS):
        for n, metered in enumerate((False, True)):
            times, _ = measure(scene, BLOCKS[-1], metered=metered)
            least[n] = min(least[n], times.sum(axis=1).min())
    return least[1] / least[0]


def seconds_per_sample(times: np.ndarray, size: int) -> float:
    """Of the fastest run."""
    return float(times.sum(axis=1).min() / times.shape[1] / size)


def cost_of_small_blocks(scene: engine.Scene, found: dict[int, tuple[np.ndarray, Simulation]]) -> tuple[float, float]:
    """How many times as long a sample takes in the smallest blocks as in the largest, beyond what a call costs; and
    that cost, µs: what a sample takes in blocks of one, beyond what it takes in the largest."""
    small, large = BLOCKS[0], BLOCKS[-1]
    per_sample = {size: seconds_per_sample(found[size][0], size) for size in (small, large)}
    call = seconds_per_sample(measure(scene, 1)[0], 1) - per_sample[large]
    beyond = per_sample[small] - (1 / small - 1 / large) * call
    return beyond / per_sample[large], call * 1e6


def factor(times: np.ndarray, size: int) -> float:
    """Times real time, of the fastest run."""
    return 1.0 / RATE / seconds_per_sample(times, size)


def worst(times: np.ndarray, size: int) -> str:
    """The dearest block as a share of its deadline: its fastest run, which is its own cost, and the slowest, with
    what else the machine did."""
    return f"{times.min(axis=0).max() * RATE / size:.1%} / {times.max() * RATE / size:.0%}"


def memory(simulation: Simulation) -> float:
    """What model and state hold, kB."""

    def size(part: object) -> int:
        if isinstance(part, np.ndarray):
            return part.nbytes
        return sum(map(size, part)) if isinstance(part, tuple) else 0

    return (size(simulation.model) + size(simulation.state)) / 1e3


def cost_of_call(call: Callable[[], None]) -> float:
    """µs that a call takes, the least of several runs."""
    return min(timeit(call, number=200) / 200 for _ in range(50)) * 1e6


def cost_in_audio_thread(scene: engine.Scene) -> float:
    """µs that the compiled callback takes for one sample: the middle of many calls, as it measures them itself."""
    from engine.live import kernels
    from engine.live.player import Player

    arguments = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p
    answer = ctypes.CFUNCTYPE(ctypes.c_int, *arguments)(kernels.portaudio_callback())
    player = Player(scene, gain=1e-3, cores=1)
    out = np.zeros((1, player.channels), np.float32)
    for _ in range(len(player.memory.shared.loads)):
        answer(None, out.ctypes.data, 1, None, 0, player.memory.address)
    return float(np.median(player.memory.shared.loads)) / RATE * 1e6


def calls() -> None:
    """What a call costs beside its samples."""
    rows = []
    for name in ("piano_c4", "barrier_linear"):
        scene = engine.load(ROOT / "patches" / f"{name}.toml")
        simulation = Simulation(*build(scene, RATE)[:2], measure_energy=False)
        nothing, memory = np.zeros((0, 2)), simulation.memory(BLOCKS[0], 2)
        costs = [
            cost_of_call(lambda s=simulation, n=nothing: s.render_block(n)),
            cost_of_call(lambda m=memory: m.render(0)),
            cost_in_audio_thread(scene),
        ]
        rows.append([name, *(f"{cost:.2f}" for cost in costs)])
    header = [
        "µs per call",
        "`Simulation.render_block`, no samples",
        "`JobMemory.render`, no samples",
        "audio callback, one sample",
    ]
    publish("calls", header, rows, "realtime")


def run() -> None:
    """Measure and publish."""
    scenes = {path.stem: engine.load(path) for path in sorted((ROOT / "patches").glob("*.toml"))}
    two = {name: measure(scene, BLOCKS[-1], 2) for name, scene in scenes.items()}
    pin()
    speeds, deadlines = [], []
    for name, scene in scenes.items():
        found = {size: measure(scene, size) for size in BLOCKS}
        times, simulation = found[BLOCKS[-1]]
        runs = np.sort(times.sum(axis=1)) / times.shape[1] / BLOCKS[-1] * 1e9
        solved = newton_statistics(simulation.model, simulation.state)
        small_blocks, call = cost_of_small_blocks(scene, found)
        speeds.append(
            [
                name,
                f"{runs[0]:.1f}",
                f"{np.median(runs):.1f}",
                *(f"{factor(t, size):.0f}" for size, (t, _) in found.items()),
                f"{factor(two[name][0], BLOCKS[-1]):.0f}" if simulation.partitions > 1 else "one subsystem",
                f"{call:.1f}",
                f"{small_blocks:.2f}",
                f"{cost_of_measuring(scene):.2f}",
                f"{simulation.energies()['error_max']:.0e}",
                f"{solved['mean']:.2f} / {solved['max']}" if solved["solves"] else "closed form",
            ]
        )
        deadlines.append([name, *(worst(t, size) for size, (t, _) in found.items()), f"{memory(simulation):.0f}"])
    header = [
        "patch",
        "ns per sample, fastest run",
        "ns per sample, median run",
        *(f"× real time, blocks of {size}" for size in BLOCKS),
        f"× real time, two cores, blocks of {BLOCKS[-1]}",
        "cost of a call, µs",
        f"time per sample without calls, blocks of {BLOCKS[0]} / {BLOCKS[-1]}",
        "time with / without energy measurement",
        "energy error",
        "iterations, mean / maximum",
    ]
    publish("realtime", header, speeds)
    sizes = [f"{size} frames" for size in BLOCKS]
    header = ["time of the worst block / deadline: fastest run / slowest run", *sizes, "memory, kB"]
    publish("deadlines", header, deadlines, "realtime")
    calls()
