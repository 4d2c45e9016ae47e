"""Other versions of the engine, checked out beside this one for as long as a measurement takes."""

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.publish.report import ROOT


def git(*words: str) -> str:
    """What git says. Raises CalledProcessError."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True, text=True).stdout.strip()


@contextmanager
def checked_out(revisions: list[str]) -> Iterator[list[Path]]:
    """Folders that hold these revisions of the project, each named by its commit. Raises CalledProcessError."""
    trees: list[Path] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            for revision in revisions:
                commit = git("rev-parse", f"{revision}^{{commit}}")
                trees.append(Path(folder) / commit)
                if not trees[-1].exists():  # the same revision twice
                    git("worktree", "add", "--detach", "--force", str(trees[-1]), commit)
            yield trees
        finally:
            for tree in {tree for tree in trees if tree.exists()}:
                git("worktree", "remove", "--force", str(tree))
