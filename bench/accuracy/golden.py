"""`uv run python -m bench golden OLD [NEW]`: does another version of the engine give the same samples, bit for bit?

OLD and NEW are revisions; NEW is the working tree if none is given. Both run on this machine, in this environment, on
the shipped patches of OLD. What differs is said with its size, as a share of the peak over the first 50 ms; of a sound
that is rendered offline, also by how much third-octave bands differ at most.
"""

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from bench.publish.report import ROOT
from bench.publish.revisions import checked_out
from engine.analysis.metrics import band_error

WORKER = Path(__file__).with_name("golden_samples.py")
EARLY = 0.05  # s, over which a difference is measured
RATE = 44_100
CORES = 2
OFFLINE = "offline"  # name of the samples whose bands are compared


def compute(tree: Path, patches: Path, folder: Path, names: list[str]) -> None:
    """Samples of the engine in a tree, of each name, into a folder. Raises CalledProcessError."""
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(folder / "kernels")}

    def run(mine: list[str]) -> None:
        words = [sys.executable, str(WORKER), str(patches), str(folder), *mine]
        subprocess.run(words, cwd=folder, env=environment, check=True)

    with ThreadPoolExecutor(CORES) as pool:
        list(pool.map(run, [names[core::CORES] for core in range(CORES)]))


def difference(old: np.ndarray, new: np.ndarray) -> float:
    """Largest difference over the first 50 ms as a share of the peak there; infinite where shapes differ; 0 only if
    all bits are the same."""
    if old.shape != new.shape or old.dtype != new.dtype:
        return np.inf
    if old.tobytes() == new.tobytes():
        return 0.0
    if old.dtype.kind not in "fi":
        return np.inf
    early = slice(0, round(EARLY * RATE))
    a, b = np.nan_to_num(old[early].astype(float)), np.nan_to_num(new[early].astype(float))
    return float(np.max(np.abs(a - b), initial=0.0) / max(np.max(np.abs(a), initial=0.0), 1e-300)) or 1e-300


def compare(old: Path, new: Path, names: list[str]) -> int:
    """Print what differs; how many arrays do."""
    count = 0
    for name in names:
        with np.load(old / f"{name}.npz") as a, np.load(new / f"{name}.npz") as b:
            found = {key: difference(a[key], b[key]) if key in b else np.inf for key in a}
            bands = band_error(b[OFFLINE], a[OFFLINE], RATE)
        wrong = {key: size for key, size in found.items() if size}
        count += len(wrong)
        said = "; ".join(f"{key} {size:.1e}" for key, size in wrong.items())
        said += f"; bands differ by at most {bands:.2f} dB" if OFFLINE in wrong else ""
        print(f"{name:<22} {len(found)} arrays, {said or 'the same bits'}", flush=True)
    return count


def main(words: list[str]) -> int:
    """0 if all bits are the same, 1 if not, 2 if they cannot be compared."""
    revisions = [word for word in words if not word.startswith("--only=")]
    only = [name for word in words if word.startswith("--only=") for name in word[7:].split(",")]
    if len(revisions) not in (1, 2):
        print("bench golden: golden OLD [NEW] [--only=PATCH,…]", file=sys.stderr)
        return 2
    kept = Path(os.environ.get("FDH_GOLDEN") or tempfile.gettempdir()) / "golden"
    try:
        with checked_out(revisions) as trees, tempfile.TemporaryDirectory() as now:
            places = [(tree, kept / tree.name) for tree in trees]
            if len(revisions) == 1:
                places.append((ROOT, Path(now)))
            patches = places[0][0] / "patches"
            names = only or sorted(path.stem for path in patches.glob("*.toml"))
            for tree, folder in places:
                compute(tree, patches, folder, names)
            return 1 if compare(places[0][1], places[1][1], names) else 0
    except subprocess.CalledProcessError as error:
        print(f"bench golden: {error} {(error.stderr or '').strip()}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
