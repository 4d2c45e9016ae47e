"""`uv run python -m bench pairs OLD [NEW] [--only=SCENE;…]`: how many times as fast is one version as another?

OLD and NEW are revisions; NEW is the working tree if none is given. Both render the same scenes on one core in turn,
several times over, and the least times are compared: a slow phase of the machine meets both.
`python bench/performance/pairs.py DOCUMENTS` is one such turn.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SECONDS = 1.0
REPEATS = 4  # renders of a scene in a turn
TURNS = 4


def documents() -> dict[str, dict]:
    """Scenes by name: the shipped patches, and bridges of many points."""
    import engine
    from bench.scenes.families import tanpuras

    found = {path.stem: engine.load(path) for path in sorted(Path("patches").glob("*.toml"))}
    for points, exponent in ((60, 1.5), (30, 1.5), (16, 1.5), (30, 1.0), (16, 1.0)):
        found[f"{points} points, α = {exponent:g}"] = tanpuras(1, points, exponent)
    return {name: scene.model_dump(mode="json", exclude_unset=True) for name, scene in found.items()}


def take_turn(path: str) -> None:
    """Print ns per sample, energy error and solves ended early of each scene, with the engine that is imported."""
    import engine

    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    found = {}
    for name, document in json.loads(Path(path).read_text("utf-8")).items():
        scene = engine.Scene.model_validate(document)
        all_stats = [engine.render(scene, seconds=SECONDS, cores=1).stats for _ in range(REPEATS)]
        last = all_stats[-1]
        capped = last["newton"]["regimes"]["capped"]
        found[name] = min(s["ns_per_sample"] for s in all_stats), last["energy"]["error_max"], capped
    print(json.dumps(found))


def main(words: list[str]) -> int:
    """Print the ratios; 2 if a version cannot be run."""
    from bench.publish.report import ROOT
    from bench.publish.revisions import checked_out

    revisions = [word for word in words if not word.startswith("--only=")]
    only = [name for word in words if word.startswith("--only=") for name in word[7:].split(";")]
    if len(revisions) not in (1, 2):
        print("bench pairs: pairs OLD [NEW] [--only=SCENE;…]", file=sys.stderr)
        return 2
    scenes = {name: document for name, document in documents().items() if not only or name in only}
    try:
        with checked_out(revisions) as trees, tempfile.NamedTemporaryFile("w", suffix=".json") as told:
            json.dump(scenes, told)
            told.flush()
            best: list[dict[str, list[float]]] = [{}, {}]
            for _ in range(TURNS):
                for tree, least in zip([*trees, ROOT], best, strict=False):
                    environment = {**os.environ, "PYTHONPATH": str(tree)}
                    command = [sys.executable, str(Path(__file__).resolve()), told.name]
                    done = subprocess.run(command, cwd=tree, env=environment, check=True, stdout=subprocess.PIPE)
                    for name, values in json.loads(done.stdout.splitlines()[-1]).items():
                        least[name] = [min(least[name][0], values[0]), *values[1:]] if name in least else values
    except subprocess.CalledProcessError as error:
        print(f"bench pairs: {error} {(error.stderr or '').strip()}", file=sys.stderr)
        return 2
    print(f"{'scene':<24} {'old ns':>8} {'new ns':>8} {'times as fast':>14}   energy error       capped")
    for name, (old, error, capped) in best[0].items():
        new, error_now, capped_now = best[1][name]
        print(
            f"{name:<24} {old:8.0f} {new:8.0f} {old / new:14.2f}   {error:.0e} → {error_now:.0e}   "
            f"{capped} → {capped_now}"
        )
    return 0


if __name__ == "__main__":
    take_turn(sys.argv[1])
