"""`uv run python -m bench.ruler.make_references [NAME …]`: make the references of the ruler, and their digests.

Each problem is solved by two methods that share nothing but its arrays, in extended precision (80 bits):

- Gauss collocation between events (bench.ruler.reference), at two settings. The finer one is the reference; the two
  differ by its self agreement.
- Taylor series (bench.ruler.taylor). It differs from the reference by the other agreement.

A third comparison, with the engine itself from the scene, tells whether the arrays are those of the scene: order 6 and
64 substeps at 4 and 8 times the sample rate, extrapolated, since its losses act between samples and err by the square
of their length. With friction, whose bristles are of order 1 while they stick: order 2 at 4096 and 8192 substeps,
extrapolated. It is in double precision, and limits nothing: the engine agreement.

Differences are of the displacement, as shares of its largest value. The horizon is the smaller of

- the frames for which a motion whose initial modes are 1 + 1e-9 and 1 - 1e-9 times as large, in turn, stays within
  1e-3 of the peak (engine.analysis.metrics.horizon; all by the same factor would only scale a motion whose contacts
  are linear, and show nothing), and
- the frames before the first at which either difference exceeds 1e-12.

Both agreements are largest differences up to the horizon. So up to there twelve digits are known, always.
"""

import hashlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import engine
from bench.ruler import reference
from bench.ruler.contact_ruler.library import FOLDER
from bench.ruler.contact_ruler.problem import Problem, Reference, read_problem, save_problem
from bench.ruler.problems import NAMES, SAMPLERATE, as_problem, ruler_scene
from bench.ruler.taylor import solve_by_series
from engine.analysis.metrics import horizon

DIGESTS = FOLDER / "digests.json"
PERTURBATION = 1e-9  # of the initial modes, relative
MAX_DIFFERENCE = 1e-12  # share of the peak
ENGINE_FACTORS = 4, 8  # multiples of the sample rate, of which the later is twice the earlier
ENGINE_SUBSTEPS = 64
FRICTION_SUBSTEPS = 4096, 8192  # at the sample rate, likewise
METHOD = "Gauss collocation between events, 20 nodes, extended precision"
OTHER_METHOD = "Taylor series of order 32 between events, extended precision"


def digest_arrays(problem: Problem, known: Reference) -> str:
    """SHA-256 of the names, shapes and values of a problem and its reference."""
    digest = hashlib.sha256()
    for part in (problem, known):
        for name, value in part._asdict().items():
            if value is None:
                continue
            if isinstance(value, str):
                digest.update(f"{name} {value}\n".encode())
            else:
                array = np.asarray(value, "<f8")
                digest.update(f"{name} {array.shape}\n".encode() + array.tobytes())
    return digest.hexdigest()


def perturb(problem: Problem) -> Problem:
    """The same problem from an initial state whose modes are a little larger and smaller, in turn."""
    factor = 1 + PERTURBATION * (-1.0) ** np.arange(problem.omega.size)
    return problem._replace(q=problem.q * factor, p=problem.p * factor)


def make_reference(problem: Problem) -> Reference:
    """Solve a problem by both methods, and once more from an initial state that is perturbed."""
    fine = reference.solve(problem)
    coarse = reference.solve(problem, reference.COARSE)
    perturbed = reference.solve(perturb(problem), reference.COARSE)
    other, _, _ = solve_by_series(problem)
    peak = np.abs(fine.displacement).max()
    of_self, of_other = (np.abs(x - fine.displacement) / peak for x in (coarse.displacement, other))
    apart = np.maximum(of_self, of_other) > MAX_DIFFERENCE
    agreed = int(np.argmax(apart)) if apart.any() else problem.frames
    both = (x.astype(float)[:, None] for x in (fine.displacement, perturbed.displacement))
    frames = min(agreed, horizon(*both, problem.samplerate), problem.frames)
    return Reference(
        displacement=fine.displacement.astype(float),
        force=fine.force.astype(float),
        energy=fine.energy.astype(float),
        horizon=frames,
        agreement=float(of_self[: frames + 1].max()),
        other_agreement=float(of_other[: frames + 1].max()),
    )


def fix_modes(scene: engine.Scene, problem: Problem) -> engine.Scene:
    """The same scene with its number of modes said, which a higher sample rate would raise. One body may lack it."""
    lacking = [k for k, body in enumerate(scene.body) if getattr(body, "modes", 1) is None]
    if not lacking:
        return scene
    (k,) = lacking
    others = sum(getattr(body, "modes", 1) for n, body in enumerate(scene.body) if n != k)
    bodies = list(scene.body)
    bodies[k] = bodies[k].model_copy(update={"modes": problem.omega.size - others})
    return scene.model_copy(update={"body": bodies})


def engine_displacement(scene: engine.Scene, problem: Problem) -> np.ndarray:
    """What the engine makes of a scene: displacement at its pickup [frames], m, extrapolated from two sample rates."""
    scene, runs = fix_modes(scene, problem), []
    if scene.friction:
        coarse, fine = (
            engine.render(scene, order=2, substeps=n, silence=-np.inf).audio[:, 0] for n in FRICTION_SUBSTEPS
        )
        return np.asarray(2 * fine - coarse)
    for factor in ENGINE_FACTORS:
        fixed = as_problem(scene, SAMPLERATE * factor)
        assert np.array_equal(fixed.omega, problem.omega) and np.array_equal(fixed.shapes, problem.shapes)
        run = engine.render(scene, samplerate=SAMPLERATE * factor, order=6, substeps=ENGINE_SUBSTEPS, silence=-np.inf)
        runs.append(run.audio[::factor, 0])
    coarse, fine = runs
    return np.asarray(fine + (fine - coarse) / 3)


def describe(problem: Problem, known: Reference, from_engine: np.ndarray) -> dict[str, Any]:
    """What is written about a reference. from_engine: displacement [frames], m"""
    apart = np.abs(from_engine - known.displacement[:-1]) / np.abs(known.displacement).max()
    return {
        "sha256": digest_arrays(problem, known),
        "modes": problem.omega.size,
        "contacts": problem.barrier.size,
        "frames": problem.frames,
        "horizon": known.horizon,
        "agreement": known.agreement,
        "other_agreement": known.other_agreement,
        "engine_agreement": float(apart[: known.horizon].max()),
        "method": METHOD,
        "other_method": OTHER_METHOD,
    }


def run(names: list[str] | None = None, folder: Path = FOLDER) -> None:
    """Make the references of some problems, or all."""
    if np.finfo(np.longdouble).eps > 2e-19:
        raise RuntimeError("references need the extended precision of an x86 processor")
    folder.mkdir(parents=True, exist_ok=True)
    digests = folder / DIGESTS.name
    known = json.loads(digests.read_text()) if digests.exists() else {}
    for name in names or NAMES:
        begin = time.perf_counter()
        scene = ruler_scene(name)
        problem = as_problem(scene)
        save_problem(folder / f"{name}.npz", problem, make_reference(problem))
        known[name] = describe(*read_problem(folder / f"{name}.npz"), engine_displacement(scene, problem))
        digests.write_text(json.dumps({n: known[n] for n in NAMES if n in known}, indent=2) + "\n")
        row = known[name]
        print(
            f"{name}: {row['modes']} modes, {row['contacts']} contacts, self agreement {row['agreement']:.1e}, "
            f"other {row['other_agreement']:.1e}, engine {row['engine_agreement']:.1e}, "
            f"horizon {row['horizon']} of {row['frames']} frames, "
            f"{time.perf_counter() - begin:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    if unknown := [name for name in sys.argv[1:] if name not in NAMES]:
        sys.exit(f"unknown {', '.join(unknown)}; some of {', '.join(NAMES)}")
    run(sys.argv[1:])
