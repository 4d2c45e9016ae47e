"""What a person is told while something takes long."""

import io
import re
import sys
import time

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.analysis.profile import profile_scene
from engine.cli import progress
from engine.cli.messages import describe_bodies
from engine.live.player import Player
from engine.live.replay import replay
from engine.offline.simulation import Simulation

BALL = ROOT / "patches" / "bouncing_ball.toml"


class Terminal(io.StringIO):
    """A standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def impatient(monkeypatch):
    """Seconds are hundredths."""
    monkeypatch.setattr(progress, "PROGRESS_DELAY", 0.02)
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.1)
    monkeypatch.setattr(progress, "MEASURED", 0.005)


def wait_for(text: str, capsys: pytest.CaptureFixture, limit: float = 5.0) -> list[str]:
    """The lines of standard error, once one has a text in it."""
    lines, end = [], time.monotonic() + limit
    while not any(text in line for line in lines):
        assert time.monotonic() < end, lines
        time.sleep(0.01)
        lines += capsys.readouterr().err.splitlines()
    return lines


def test_without_a_terminal_a_line_comes_now_and_then(impatient, capsys):
    with progress.progress_feedback("rendering") as update:
        update(0.0)
        time.sleep(0.05)
        update(0.25)
        (line,) = wait_for("25%", capsys)
        assert re.fullmatch(r"rendering: 25% done, about \d+ s left", line)
        update(0.75)
        assert wait_for("75%", capsys)
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_a_task_that_tells_no_share_is_said_to_go_on(impatient, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    with progress.progress_feedback("drawing the page"):
        assert re.fullmatch(r"drawing the page: \d+ s so far", wait_for("so far", capsys)[0])


def test_that_a_kernel_is_compiled_is_said_at_once(impatient, monkeypatch, capsys):
    """Numba is imported only to compile."""
    monkeypatch.setattr(progress, "LINE_INTERVAL", 60.0)
    monkeypatch.setitem(sys.modules, "numba", sys)
    with progress.progress_feedback("rendering") as update:
        assert wait_for("…", capsys) == ["compiling the kernel (once per machine) …"]
        update(0.5)
    assert capsys.readouterr().err == ""


def test_what_is_large_is_named_before_it_is_built_then_how_long_it_will_take(impatient, monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    with progress.progress_feedback("rendering", "226 strings and 2 plates") as update:
        assert wait_for("building", capsys) == ["building 226 strings and 2 plates …"]
        update(0.0)
        time.sleep(0.05)
        update(0.0005)
        assert re.fullmatch(r"226 strings and 2 plates: about \d+ min", wait_for("about", capsys)[-1])
        update(0.5)
        assert re.fullmatch(r"rendering: 50% done, about \d+ s left", wait_for("50%", capsys)[-1])


def test_a_task_that_says_the_time_left_is_not_guessed_at_when_it_does_not_know():
    """A last part of which no share is known may take many times what the mean speed says."""
    task = progress.Progress("comparing settings")
    task(0.0, "building")
    task(0.5, "timing", 30.0)
    assert task.seconds_left() == pytest.approx(30.0, abs=1.0)
    task(0.95, "comparing errors")
    assert task.seconds_left() is None and task.describe_rest() == ""


def test_the_time_left_is_as_the_task_says_where_it_knows_better_than_the_mean_speed(impatient, capsys):
    """It falls while nothing is reported, and is not shown once it is over."""
    with progress.progress_feedback("comparing settings") as update:
        update(0.5, "refining the reference", 60.0)
        assert wait_for("about", capsys) == ["comparing settings: about 1 min"]
        update(0.5, "refining the reference", 30.0)
        line = wait_for("% done", capsys)[-1]
        assert re.fullmatch(r"comparing settings: 50% done \(refining the reference\), about (2\d|30) s left", line)
        time.sleep(1.0)
        assert int(wait_for("% done", capsys)[-1].split()[-3]) < int(line.split()[-3])
        update(0.5, "refining the reference", 0.01)
        time.sleep(0.05)
        capsys.readouterr()
        assert wait_for("50%", capsys)[-1] == "comparing settings: 50% done (refining the reference)"


@pytest.mark.parametrize(
    ("seconds", "says"), [(12.4, "about 12 s"), (58.0, "about 1 min"), (400.0, "about 7 min"), (7200.0, "about 2 h")]
)
def test_times_are_said_as_one_says_them(seconds, says):
    assert progress.format_duration(seconds) == says


def test_bodies_are_counted_by_kind():
    assert describe_bodies(engine.load(BALL)) == "1 mass"
    lumps = [{"name": f"m{n}", "kind": "mass", "mass": 1.0} for n in range(2)]
    string = engine.load("tanpura").model_dump(exclude_none=True)["body"]
    scene = engine.Scene.model_validate({"body": [*string, *lumps], "pickup": [{"body": "m0"}]})
    assert describe_bodies(scene) == "2 masses and 1 string"


def test_what_is_quick_says_nothing(capsys):
    with progress.progress_feedback("rendering") as update:
        update(1.0)
    assert capsys.readouterr().err == ""


def test_on_a_terminal_there_is_a_bar_that_goes_away(impatient, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("TERM", "xterm")
    with progress.progress_feedback("rendering") as update:
        update(0.4)
        end = time.monotonic() + 5.0
        while "rendering" not in sys.stderr.getvalue() or "40%" not in sys.stderr.getvalue():
            assert time.monotonic() < end, sys.stderr.getvalue()
            time.sleep(0.01)
    assert sys.stderr.getvalue().endswith("\x1b[2K"), "the line is erased"


@pytest.mark.parametrize("task", ["render", "replay", "profile"])
def test_long_tasks_tell_the_share_done(task):
    scene, shares = engine.load(BALL), []
    if task == "render":
        engine.render(scene, progress=shares.append)
    elif task == "profile":
        profile_scene(scene, 0.5, progress=shares.append)
    else:
        player = Player(scene, seconds=1.0)
        player.render_into(np.zeros((44_100, player.channels), np.float32))
        replay(player.log(), shares.append)
    assert shares == sorted(shares) and len(set(shares)) > 1
    assert 0.0 <= shares[0] < 0.1 and 0.5 < shares[-1] <= 1.0


def test_how_long_a_slow_rendering_will_take_is_said_in_its_first_moments(impatient, monkeypatch, capsys):
    """The first samples tell, though each takes 10 ms; not only the second chunk."""
    block, said = Simulation.render_block, []

    def slow(self, out, trace=None):
        time.sleep(0.01 * len(out))
        said.extend(capsys.readouterr().err.splitlines())
        if any("about" in line for line in said):
            raise KeyboardInterrupt
        block(self, out, trace)

    monkeypatch.setattr(Simulation, "render_block", slow)
    with pytest.raises(KeyboardInterrupt) as stop, progress.progress_feedback("rendering", "1 mass") as update:
        engine.render(engine.load(BALL), seconds=60.0, progress=update)
    assert re.fullmatch(r"1 mass: about \d+ h", said[-1])
    assert len(stop.value.rendering.audio) <= 64
