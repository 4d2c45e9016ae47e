"""This engine against its peers, in the same run, with the error and the limits of each.

The same scheme written by hand in C; explicit mass-interaction models, as Faust's mi.lib compiles them; leapfrog with a
discrete gradient in NumPy; an adaptive solver of SciPy; and the fixed-step methods of
bench.rivals.single_body. The sources in C and Faust are beside this file.
"""

import ctypes
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.accuracy.hard import scene_of
from bench.performance.turns import FRAMES, RATE, Replay, time_in_turn
from bench.publish.report import ROOT, pin, publish
from bench.rivals.leapfrog import Leapfrog
from bench.rivals.single_body import SingleBody
from bench.rivals.single_body_errors import methods_beside
from bench.scenes.families import bank, hammered
from engine.analysis.work_precision import measure_work_precision
from engine.assembly.array_memory import align_to_cache_lines
from engine.assembly.build import build
from engine.kernel.data.effects import CONTACTS, TWO_BODIES
from engine.kernel.data.laws import Law
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.simulation import Simulation
from engine.patch.accuracy import Accuracy

RIVALS = ROOT / "bench" / "rivals"
# no -ffast-math: sums become vector code where a pragma says so, and what rounding leaves of a step is carried
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fopenmp-simd", "-shared", "-fPIC")
HEADER = [
    "scene",
    "compared with",
    "ns per sample, the other",
    "ns per sample, this engine",
    "this engine / the other",
    "ns per sample, this engine, energies measured",
    "error, the other",
    "error, this engine",
    "limits of the other",
]
LANES = 8  # numbers of a vector register; arrays of modes are padded to a multiple
PIECE = 64  # samples: what the C sources run is a multiple
AGREED = 138 * PIECE  # samples, 0.2 s, over which C and ours have to agree
SLACK = 40.0  # N, of a string with 300 modes
BANKS = (64, 1000, 20_000)
DIFFERENCE = 1e-9  # relative, at most


class Times(NamedTuple):
    """Seconds per sample."""

    theirs: float
    ours: float
    metered: float | None = None  # ours, with energies measured


def in_turn(
    scene: engine.Scene, rival: "Written | Explicit | Leapfrog", channels: int, frames: int
) -> tuple[Times, float]:
    """The times of a rival and of ours, and our energy error."""
    out, plain, metered = (
        np.zeros((channels, FRAMES)),
        Replay(scene, frames / RATE),
        Replay(scene, frames / RATE, metered=True),
    )

    def run() -> float:
        rival.reset()
        begin = time.perf_counter()
        for _ in range(frames // FRAMES):
            rival.block(out)
        return (time.perf_counter() - begin) / frames

    times = time_in_turn(run, plain, metered)
    return Times(*(taken.median for taken in times)), metered.simulation.energies()["error_max"]


def row(scene: str, peer: str, times: Times, errors: tuple[str, str], lacks: str) -> list[str]:
    """A row of the table."""
    metered = "" if times.metered is None else f"{times.metered * 1e9:.3g}"
    ratio = f"{times.ours / times.theirs:.2g}"
    return [scene, peer, f"{times.theirs * 1e9:.3g}", f"{times.ours * 1e9:.3g}", ratio, metered, *errors, lacks]


def skipped(scene: str, peer: str, package: str) -> list[str]:
    """A row for a peer that is not installed."""
    return [scene, peer, *["skipped"] * 6, f"to run it: apt-get install {package}"]


def compiled(folder: Path, source: Path, *flags: str) -> ctypes.CDLL:
    """A C source as a library."""
    library = Path(tempfile.mkdtemp(dir=folder)) / f"{source.stem}.so"
    subprocess.run(["cc", *FLAGS, *flags, "-o", library, source, "-lm"], check=True)
    return ctypes.CDLL(str(library))


# --- the same scheme in C


class Case(NamedTuple):
    """A scene written in C: its source, and the names of the tables it is given, one after the other."""

    name: str
    source: str
    tables: str
    scene: engine.Scene
    frames: int
    fixed: bool = True  # the number of modes is known to the compiler, so that it unrolls all loops


def leaning() -> engine.Scene:
    """A string against which a weight leans: in contact throughout."""
    scene = hammered(1, 61)
    string, hammer = scene.body
    weight = hammer.model_copy(update={"mass": 300.0, "velocity": 0.02, "displacement": 0.0})
    return scene.model_copy(update={"body": [string, weight]})


def repelled() -> engine.Scene:
    """The oscillator of the paper's Fig. 6."""
    return engine.load(ROOT / "patches" / "repelled_oscillator.toml")


def cases() -> list[Case]:
    """The scenes written in C."""
    hammer, barrier = (
        "pull drift keep kick move ear shape stiffness room scalars",
        "pull drift shape kick move ear scalars",
    )
    struck, leant = "hammer on a string of 61 modes, α = 2.5", "the same, with a weight that never leaves the string"
    return [
        *(Case(f"free bank of {n} modes", "bank.c", "pull drift keep ear", bank(n), FRAMES) for n in BANKS),
        Case(struck, "hammer.c", hammer, hammered(1, 61), 4 * FRAMES),
        Case(struck, "hammer.c", hammer, hammered(1, 61), 4 * FRAMES, False),
        Case("the same with 300 modes", "hammer.c", hammer, hammered(1, 300, SLACK), FRAMES),
        Case(leant, "hammer.c", hammer, leaning(), FRAMES),
        Case(leant, "hammer.c", hammer, leaning(), FRAMES, False),
        Case("oscillator at a barrier, α = 2", "barrier.c", barrier, repelled(), 4 * FRAMES),
    ]


def tables_of(model: Model, state: State, width: int) -> dict[str, np.ndarray]:
    """The tables of a scene, padded: those of its modes, and how its contact and its pickup see them."""
    modes, contact, pickups, h = model.step.kick.size, model.contact, model.pickups, model.step

    def padded(values: Any) -> np.ndarray:
        return np.pad(np.broadcast_to(values, modes), (0, width - modes))

    def over(rows: Any, values: np.ndarray) -> np.ndarray:
        dense = np.zeros(width)
        first, last, at = int(rows.mode_begin[0]), int(rows.mode_end[0]), int(rows.offset[0])
        dense[first:last] = values[at : at + last - first]
        return dense

    stiffness = padded(model.omega_squared)
    tables = {
        "pull": padded(h.spring_kick),
        "drift": padded(h.drift),
        "keep": padded(h.loss.decay_factor),
        "stiffness": stiffness,
        "ear": over(pickups.rows, pickups.rows.phi) * pickups.gain[0],
    }
    if model.effects & CONTACTS:
        ends = [(contact.rows, h.contact.rows)]
        if model.effects & TWO_BODIES:
            ends.append((contact.other_rows, h.contact.other_rows))
        tables["shape"] = np.sum([over(rows, rows.phi) for rows, _ in ends], axis=0)
        tables["kick"] = np.sum([over(rows, step.kick_phi) for rows, step in ends], axis=0)
        tables["move"] = np.sum([over(rows, step.drift_phi) for rows, step in ends], axis=0)
        with np.errstate(divide="ignore"):  # how far a mode moves the contact in a PIECE, per unit of its speed
            tables["room"] = np.abs(tables["shape"]) * np.minimum(PIECE / model.samplerate, 2 / np.sqrt(stiffness))
        tables["scalars"] = np.array(
            [contact.nominal_barrier[0], h.contact.compliance[0], state.potential_coefficient[0]]
        )
    return tables


def aligned(array: np.ndarray) -> np.ndarray:
    """A copy of an array, which begins where a cache line does."""
    copy: np.ndarray = align_to_cache_lines(Law(array, array)).exponent
    return copy


class Written:
    """A scene in C, from the tables and the initial state that the engine built."""

    def __init__(self, case: Case, folder: Path, model: Model, state: State) -> None:
        self.modes = state.p.size
        self.width = -(-self.modes // LANES) * LANES if self.modes > 1 else 1
        tables = tables_of(model, state, self.width)
        self.tables = aligned(np.concatenate([tables[name] for name in case.tables.split()]))
        spare = np.zeros(self.width - self.modes)
        contact = [state.compression, np.zeros(1)]  # and what rounding left
        self.state = aligned(np.concatenate([state.q, spare, state.p, spare, *contact]))
        modes = f"{self.width}" if case.fixed else "modes"  # a number, or a variable of the source
        self.library = compiled(folder, RIVALS / case.source, f"-DMODES={modes}")
        ctypes.c_long.in_dll(self.library, "modes").value = self.width
        self.saved = self.state.copy()

    def reset(self) -> None:
        """Back to the saved state, elsewhere: where large arrays lie changes their time by half."""
        self.state, self.tables = aligned(self.saved), aligned(self.tables)

    def block(self, out: np.ndarray) -> None:
        """As Simulation.block."""
        arrays = (ctypes.c_void_p(array.ctypes.data) for array in (self.tables, self.state, out))
        self.library.run(ctypes.c_long(out.shape[1]), *arrays)


def in_c(case: Case, folder: Path) -> list[str]:
    """The row of a scene in C, which has to give what the engine gives."""
    model, state, _ = build(case.scene, RATE, Accuracy(silence=-np.inf))
    if not state.p.any():
        state.p[:] = 1.0  # as bench.performance.turns.Replay has it
    rival, heard, ours = Written(case, folder, model, state), np.zeros((1, AGREED)), np.zeros((AGREED, 1))
    rival.block(heard)
    Simulation(model, state, measure_energy=False).render_block(ours)
    off = float(np.abs(heard[0] - ours[:, 0]).max() / np.abs(ours).max())
    assert off <= DIFFERENCE, f"{case.name}: C differs by {off:.0e}"
    rival.reset()
    rival.block(heard[:, :PIECE])  # measure() too saves the state there
    rival.saved[:] = rival.state
    times, error = in_turn(case.scene, rival, 1, case.frames)
    errors = f"difference {off:.0e}", f"energy {error:.0e}"
    lacks = "only this scene and number of modes" if case.fixed else "only this scene"
    return row(case.name, "hand-written C", times, errors, lacks)


# --- explicit mass-interaction models

# the hammer, the oscillator, and a string of masses (that of bench.scenes.families.hammered, without stiffness)
HAMMER, FROM, SPEED = 2.97e-3, -1e-3, 2.0  # kg, m, m/s
OSCILLATOR, PITCH = 0.01, 440.0  # kg, Hz
MASSES, HIT, EAR, LENGTH, WEIGHT, TENSION = 60, 7, 54, 0.62, 3.93e-3, 670.0
FELT = 3e4  # N/m, α = 1
STIFFER = (1, 100, 10_000)


class Chain(NamedTuple):
    """What mi.lib is given: masses joined by springs, the two outer ones to the ground if they are a string."""

    masses: int
    mass: float  # kg
    spring: float  # N/m
    hit: int

    def energy(self, places: np.ndarray, stiffness: float) -> np.ndarray:
        """Energy of each step [samples - 1] from places [masses and hammer, samples], J, as leapfrog keeps it."""
        speeds = np.diff(places) * RATE
        fixed = np.diff(np.pad(places[:-1], ((1, 1), (0, 0))), axis=0) if self.masses > 1 else places[:1]
        pressed = np.maximum(places[-1] - places[self.hit], 0.0)
        kinetic = 0.5 * self.mass * np.sum(speeds[:-1] ** 2, axis=0) + 0.5 * HAMMER * speeds[-1] ** 2
        stored = 0.5 * self.spring * np.sum(fixed[:, 1:] * fixed[:, :-1], axis=0)
        return np.asarray(kinetic + stored + 0.5 * stiffness * pressed[1:] * pressed[:-1])


SINGLE = Chain(1, OSCILLATOR, OSCILLATOR * (2 * np.pi * PITCH) ** 2, 0)
STRING = Chain(MASSES, WEIGHT / (MASSES + 1), TENSION * (MASSES + 1) / LENGTH, HIT)


def as_modes(chain: Chain, stiffness: float) -> engine.Scene:
    """The same masses as the engine has them: by the modes of the chain."""
    if chain.masses == 1:
        body = {"kind": "oscillator", "mass": chain.mass, "stiffness": chain.spring}
        hit, ear = {}, {}
    else:
        number = np.arange(1, chain.masses + 1)
        angle = np.pi * number / (chain.masses + 1)
        frequency = np.sqrt(chain.spring / chain.mass) * np.sin(angle / 2) / np.pi
        scale = np.sqrt(2 / (chain.mass * (chain.masses + 1)))
        points = {name: (scale * np.sin((at + 1) * angle)).tolist() for name, at in (("hit", HIT), ("ear", EAR))}
        body = {"kind": "modes", "frequency": frequency.tolist(), "sigma": [0.0] * chain.masses, "points": points}
        hit, ear = {"on_at": "hit"}, {"at": "ear"}
    hammer = {"name": "hammer", "kind": "mass", "mass": HAMMER, "displacement": FROM, "velocity": SPEED}
    contact = {"body": "hammer", "on": "body", "stiffness": stiffness, "exponent": 1.0} | hit
    heard = {"body": "body", "quantity": "displacement"} | ear
    return engine.Scene.model_validate(
        {
            "body": [body | {"name": "body"}, hammer],
            "contact": [contact],
            "pickup": [heard, {"body": "hammer", "quantity": "displacement", "channel": 2}],
        }
    )


class Explicit:
    """A model that Faust compiled. entry: what it gives: `process`, two places; `all`, every place."""

    def __init__(self, chain: Chain, stiffness: float, folder: Path, entry: str) -> None:
        values = {"MASS": chain.mass, "SPRING": chain.spring / RATE**2, "STIFFNESS": stiffness / RATE**2}
        values |= {"HAMMER": HAMMER, "FROM": FROM, "BEFORE": FROM - SPEED / RATE}
        values |= {"N": chain.masses, "AT": chain.hit, "HEARD": EAR}
        folder = Path(tempfile.mkdtemp(dir=folder))
        (folder / "scene.lib").write_text("".join(f"{name} = {value!r};\n" for name, value in values.items()))
        model = RIVALS / ("oscillator.dsp" if chain.masses == 1 else "chain.dsp")
        source = folder / "model.c"
        options = ("-lang", "c", "-double", "-pn", entry, "-I", str(folder))
        subprocess.run(["faust", *options, "-o", str(source), str(model)], check=True)
        include = subprocess.run(["faust", "-includedir"], check=True, capture_output=True, text=True).stdout.strip()
        glue = ("-DFAUSTFLOAT=double", f"-I{include}", "-include", "faust/gui/CInterface.h")
        self.library = compiled(folder, source, *glue)
        self.library.newmydsp.restype = ctypes.c_void_p
        self.model = ctypes.c_void_p(self.library.newmydsp())
        self.channels = self.library.getNumOutputsmydsp(self.model)
        self.library.initmydsp(self.model, RATE)

    def reset(self) -> None:
        """Back to the start."""
        self.library.instanceClearmydsp(self.model)

    def block(self, out: np.ndarray) -> None:
        """Places, m."""
        outputs = (ctypes.c_void_p * self.channels)(*(channel.ctypes.data for channel in out))
        self.library.computemydsp(self.model, out.shape[1], None, outputs)


def explicit(name: str, chain: Chain, stiffer: int, folder: Path) -> list[str]:
    """The row of a mass-interaction model."""
    stiffness = FELT * stiffer
    scene, places = as_modes(chain, stiffness), np.zeros((chain.masses + 1, FRAMES))
    Explicit(chain, stiffness, folder, "all").block(places)
    with np.errstate(all="ignore"):
        energy = chain.energy(places, stiffness)
        off = np.abs(energy / energy[0] - 1).max()
    failed = f"**blows up**, energy × {off:.0e}" if off > 1.0 else f"energy {off:.0e}"
    rival = Explicit(chain, stiffness, folder, "process")
    times, error = in_turn(scene, rival, 2, 4 * FRAMES)
    lacks = "unstable for stiff contacts" if off > 1.0 else "inexact pitch; exponents 1 and 3 only"
    errors = failed, f"energy {error:.0e}"
    return row(f"{name}, contact × {stiffer}", "mi.lib", times, errors, lacks)


def in_numpy(name: str, chain: Chain, stiffer: int) -> list[str]:
    """The row of the same masses, by leapfrog and a discrete gradient over two steps in NumPy."""
    stiffness = FELT * stiffer
    rival = Leapfrog(chain, EAR, (stiffness, 1.0), (HAMMER, FROM, SPEED))
    before = rival.energy()
    rival.block(np.zeros((2, FRAMES)))
    off = abs(rival.energy() / before - 1)
    times, error = in_turn(as_modes(chain, stiffness), rival, 2, FRAMES)
    errors = f"energy {off:.0e}", f"energy {error:.0e}"
    return row(
        f"{name}, contact × {stiffer}", "physsynth's scheme, NumPy", times, errors, "not in real time; inexact pitch"
    )


# --- other methods at matched error

GOAL = 1e-2  # error, relative
WALLS = SingleBody(0.0, 1e11, 1.0, 1e-3, -1e-3, 0.0), 0.0, 2.0  # stiff, 2 mm apart


def cheapest(rows: list[dict[str, Any]], goal: float) -> dict[str, Any]:
    """The cheapest whose error is no larger than the goal."""
    return min((r for r in rows if r["error"] <= goal), key=lambda r: r["ns_per_sample"])


def matched(name: str, scene: engine.Scene, seconds: float) -> list[list[str]]:
    """Rows of an adaptive solver and of the cheapest of the fixed-step methods, each at settings that meet the goal."""
    found, rows = measure_work_precision(scene, seconds), []
    own = cheapest(found["rows"], GOAL)
    others = methods_beside(found, scene)
    adaptive = [r for r in others if r["setting"].startswith("DOP853")]
    fixed = [r for r in others if r not in adaptive]
    for peers, lacks in (
        (adaptive, "not in real time; inexact energy"),
        (fixed, "inexact energy; unstable for stiff contacts"),
    ):
        peer = cheapest(peers, GOAL)
        errors = f"{peer['error']:.0e}, energy {peer['energy_error']:.0e}", f"{own['error']:.0e} ({own['setting']})"
        rows.append(
            row(name, peer["setting"], Times(peer["ns_per_sample"] * 1e-9, own["ns_per_sample"] * 1e-9), errors, lacks)
        )
    return rows


def run() -> None:
    """Measure and publish."""
    pin()
    rows: list[list[str]] = []
    c, faust = (all(map(shutil.which, tools)) for tools in (["cc"], ["cc", "faust"]))
    with tempfile.TemporaryDirectory() as folder:
        for case in cases():
            rows.append(in_c(case, Path(folder)) if c else skipped(case.name, "hand-written C", "gcc"))
        for name, chain in (("hammered oscillator", SINGLE), ("hammered string of 60 masses", STRING)):
            for stiffer in STIFFER if faust else ():
                rows.append(explicit(name, chain, stiffer, Path(folder)))
            rows.append(in_numpy(name, chain, STIFFER[0]))
            if not faust:
                rows.append(skipped(name, "mi.lib", "faust gcc"))
    rows += matched("repelled oscillator, 50 ms", repelled(), 0.05)
    rows += matched("between stiff walls, 50 ms", scene_of(*WALLS), 0.05)
    publish("peers", HEADER, rows)
