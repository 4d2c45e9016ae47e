"""The tricks of the compiler: all work with this Numba, and without them the samples are the same."""

import hashlib
import os
import subprocess
import sys

import pytest
from conftest import ROOT

from engine.compiler import tricks
from engine.compiler.tricks import FOUND, Trick

SOUND = """
import hashlib, sys, engine
from bench.scenes.families import tanpuras
kernel, *names = sys.argv[1:]
for name in names:
    seconds = {"repelled_oscillator": 0.1, "guitar_frets": 0.02, "a bridge of twelve points": 0.05}[name]
    scene = tanpuras(1, 12, 1.5) if " " in name else engine.load(name)
    rendering = engine.render(scene, seconds=seconds, trace=True, kernel=kernel)
    arrays = [rendering.audio, *(rendering.trace[key] for key in ("displacement", "velocity", "force", "iterations"))]
    print(name.replace(" ", "_"), *(hashlib.sha256(array.tobytes()).hexdigest() for array in arrays))
"""


def test_all_are_in_use_with_this_numba():
    import engine.live.audio_thread  # with which all of the compiler is imported
    import engine.offline.render  # noqa: F401

    assert {trick for trick, found in FOUND.items() if found} == set(Trick) - tricks.switched_off()


def test_one_whose_self_test_fails_is_not_in_use(monkeypatch):
    monkeypatch.setattr(tricks, "FOUND", {})
    assert not tricks.in_use(Trick.FORCED_INLINING, lambda: {}["a part of Numba that is gone"])
    assert tricks.in_use(Trick.FORCED_INLINING, lambda: True)


def test_a_name_that_is_no_trick_is_refused(monkeypatch):
    monkeypatch.setenv("FDH_PLAIN", "array_views, vectors")
    tricks.switched_off.cache_clear()
    try:
        with pytest.raises(ValueError, match="no trick is named vectors; all, array_views, lanes, skip_inlined"):
            tricks.switched_off()
    finally:
        monkeypatch.undo()
        tricks.switched_off.cache_clear()


def sounds(folder, plain: str, kernel: str, *scenes: str) -> list[str]:
    """For each scene, digests of what it becomes, in a process of its own."""
    environment = {**os.environ, "FDH_PLAIN": plain, "NUMBA_CACHE_DIR": str(folder)}
    command = [sys.executable, "-c", SOUND, kernel, *scenes]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.hard
@pytest.mark.slow_but("array_views, lanes-guitar_frets")
@pytest.mark.parametrize(
    ("plain", "name"),
    [
        ("array_views, lanes", "guitar_frets"),
        ("array_views, lanes", "a bridge of twelve points"),
        ("array_views, lanes", "repelled_oscillator"),
        ("all", "repelled_oscillator"),
    ],
)
def test_without_them_the_samples_are_the_same(plain, name, tmp_path):
    """Motion and forces, bit for bit, as of the kernel that is shipped: without those by which arithmetic is written,
    and with all switched off, where one scene takes minutes to compile."""
    [with_tricks] = sounds(tmp_path, "", "general", name)
    assert hashlib.sha256(b"").hexdigest() not in with_tricks and len(with_tricks.split()) == 6
    assert sounds(tmp_path, plain, "special", name) == [with_tricks]
