"""Sweeps: the points of a plan rendered, by several processes or a cluster, that can be stopped at any time."""

import dataclasses
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import psutil
import pytest
import soundfile
from conftest import ROOT
from sweeps import MARBLE, SECONDS, Alone, plan, rows, swept

import engine
from engine.cli import main
from engine.cli.arguments import ACCURACY_OPTIONS
from engine.report import console
from engine.sound.form import SoundForm
from engine.sweep import index_csv
from engine.sweep.local_workers import run_local
from engine.sweep.sound_names import is_name_of_number, sound_name
from engine.sweep.sweep import run_sweep
from engine.sweep.task import RenderTask, render_task

NEAR = "body.marble.displacement=1e-4..1e-3:log:3"
MASS = "body.marble.mass=0.002,0.004,0.2"
BELL = "body.bell.frequency=700,44000"  # the second is above the Nyquist frequency
NAMES = [f"000{n}_marble_displacement_{value}.wav" for n, value in enumerate(("0p0001", "0p000316228", "0p001"), 1)]


@pytest.mark.hard
def test_a_grid_on_two_processes(tmp_path, capsys):
    """One sound and one row each, the same samples as of a single render; what fails does not stop the rest."""
    folder = tmp_path / "out"
    words = ["--vary", NEAR, "--vary", BELL, "--seconds", str(SECONDS), "--subtype", "DOUBLE", "--cores", "2"]
    assert main.main(["sweep", MARBLE, "-o", str(folder), *words, "--gain", "0", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["points"], told["done"], told["failed"], told["index"]) == (6, 3, 3, str(folder / "index.csv"))
    found = rows(folder)
    assert [row["number"] for row in found] == ["1", "2", "3", "4", "5", "6"]
    for row in found[1::2]:
        assert (row["file"], row["peak"]) == ("", "")
        assert row["status"].startswith("body[1]: vibrates at 44000 Hz, above 0.49 of the sample rate")
    for row in found[::2]:
        assert row["status"] == "done"
        made = plan(NEAR, BELL)
        rendering = engine.render(made.scene(made.points[int(row["number"]) - 1]), seconds=SECONDS)
        np.testing.assert_array_equal(soundfile.read(folder / row["file"], always_2d=True)[0], rendering.audio)
        assert float(row["peak"]) == pytest.approx(rendering.stats["peak"], rel=1e-8)
        assert float(row["contact"]) == pytest.approx(rendering.stats["activity"]["contact"], rel=1e-8)
        assert 500.0 < float(row["fundamental_hz"]) < 900.0
    assert {p.name for p in folder.iterdir()} == {"index.csv", *(row["file"] for row in found[::2])}
    assert swept(tmp_path / "alone", NEAR, BELL, gain=0.0)[0].failed == 3
    assert [row | {"fingerprint": ""} for row in rows(tmp_path / "alone")] == [r | {"fingerprint": ""} for r in found]


def test_sounds_have_one_gain_so_that_their_levels_compare(tmp_path):
    """The loudest is normalised; the others are as much softer as their renderings are."""
    outcome, _ = swept(tmp_path, "body.marble.displacement=1e-4", MASS)
    found = rows(tmp_path)
    peaks = [float(row["peak"]) for row in found]
    levels = [np.abs(soundfile.read(tmp_path / row["file"])[0]).max() for row in found]
    assert max(levels) == pytest.approx(10 ** (-1 / 20), rel=1e-6)
    assert [level / max(levels) for level in levels] == pytest.approx([peak / max(peaks) for peak in peaks], rel=1e-6)
    assert min(levels) < 0.9 * max(levels)
    assert [float(row["gain_db"]) for row in found] == pytest.approx([outcome.gain_db] * 3)
    assert not (tmp_path / "unscaled").exists()


def test_names_of_sounds_say_what_varies(tmp_path):
    swept(tmp_path, "body.marble.mass=0.002,1e-2", "contact.glass.stiffness=1e9..1e10:log:2")
    assert sorted(path.name for path in tmp_path.glob("*.wav")) == [
        "0001_marble_mass_0p002_glass_stiffness_1e9.wav",
        "0002_marble_mass_0p002_glass_stiffness_1e10.wav",
        "0003_marble_mass_0p01_glass_stiffness_1e9.wav",
        "0004_marble_mass_0p01_glass_stiffness_1e10.wav",
    ]
    assert [row["file"] for row in rows(tmp_path)] == sorted(path.name for path in tmp_path.glob("*.wav"))


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ([("contact.felt.stiffness", 1e7), ("body.a.velocity", -2.5e-11)], "felt_stiffness_1e7_a_velocity_-2p5e-11"),
        ([("seconds", 2), ("accuracy.order", 4)], "seconds_2_accuracy_order_4"),
        ([("contact.0.stiffness", 12_345_678.9)], "contact_0_stiffness_1p23457e7"),
        ([("body.a.t60.1", 10**400)], f"a_t60_1_1{'0' * 19}"),
        ([("body.b.file", "../Glocke ü/a:b*?.csv")], "b_file__Glocke_a_b_csv"),
        ([("body." + "x" * 300 + ".mass", 1.0)], "x" * 27 + "_mass_1"),
        ([(f"body.{n}a.frequency", 440.0) for n in range(9)], "_".join(f"body_{n}a_frequency_440" for n in range(3))),
    ],
)
def test_names_are_good_for_every_file_system(values, name):
    """Short, with no letter that a system or a shell takes for something else."""
    assert sound_name(7, values) == f"0007_{name}.wav"
    assert len(sound_name(7, values)) <= 80 and is_name_of_number(sound_name(7, values), 7)


def test_sounds_of_another_value_take_the_place_of_those_of_before(tmp_path):
    swept(tmp_path, "body.marble.mass=0.002,0.004")
    (tmp_path / "notes.txt").write_text("of the user")
    outcome, given = swept(tmp_path, "body.marble.mass=0.002,0.008,0.016")
    assert (outcome.overwritten, outcome.already_done, given) == (1, 1, [2, 3])
    sounds = {f"000{n}_marble_mass_{mass}.wav" for n, mass in ((1, "0p002"), (2, "0p008"), (3, "0p016"))}
    assert {path.name for path in tmp_path.iterdir()} == {*sounds, "index.csv", "notes.txt"}


@pytest.mark.hard
def test_more_points_change_the_gain_of_all(tmp_path):
    """Those that are there already are brought to it; in files of integers they are rendered again."""
    for subtype, again in (("FLOAT", 0), ("PCM_16", 2)):
        folder = tmp_path / subtype
        near = "body.marble.displacement=1e-4"
        made = [plan(near, "body.marble.mass=0.002,0.004"), plan(near, MASS)]
        options = {"seconds": SECONDS, "samplerate": 44_100}
        first, more = (run_sweep(points, folder, Alone(), options, SoundForm(subtype)) for points in made)
        assert more.gain_db < first.gain_db - 1.0 and more.gone == again
        assert run_sweep(made[1], folder, Alone(), options, SoundForm(subtype)).done == 3
        for row in rows(folder):
            level = np.abs(soundfile.read(folder / row["file"])[0]).max()
            assert level == pytest.approx(float(row["peak"]) * 10 ** (more.gain_db / 20), rel=1e-3)


@pytest.mark.hard
def test_a_folder_of_an_earlier_version_is_left_alone(tmp_path, capsys):
    """Its sounds were called 0001.wav, and each had a level of its own."""
    swept(tmp_path, NEAR)
    index = tmp_path / "index.csv"
    for n, name in enumerate(NAMES, 1):
        (tmp_path / name).rename(tmp_path / f"000{n}.wav")
        index.write_text(index.read_text("utf-8").replace(name, f"000{n}.wav"), "utf-8")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert main.main(["sweep", MARBLE, "-o", str(tmp_path), "--vary", NEAR]) == 2
    said = capsys.readouterr().err
    assert "is of an earlier version, which named sounds only by numbers" in said and said.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert len(engine.read_sweep(tmp_path).peak) == 3


@pytest.mark.hard
def test_only_what_is_missing_changed_or_failed_is_rendered_again(tmp_path):
    whole = swept(tmp_path, NEAR, BELL)[0]
    assert (whole.points, whole.done, whole.failed, whole.exit_code) == (6, 3, 3, 1)
    before = (tmp_path / "index.csv").read_bytes()
    assert swept(tmp_path, NEAR, BELL)[1] == [2, 4, 6]
    (tmp_path / rows(tmp_path)[2]["file"]).unlink()
    again, given = swept(tmp_path, NEAR, BELL)
    assert (again.already_done, given) == (2, [2, 3, 4, 6])
    assert (tmp_path / "index.csv").read_bytes() == before
    assert again.overwritten == 0
    louder, given = swept(tmp_path, NEAR, BELL, gain=3.0)
    assert (louder.overwritten, len(given)) == (3, 6)
    assert len(swept(tmp_path, NEAR, BELL, order=4)[1]) == 6
    other = tmp_path / "p.toml"
    other.write_text(Path(MARBLE).read_text("utf-8").replace("gravity = 9.81", "gravity = 9.82"), "utf-8")
    assert len(swept(tmp_path, NEAR, BELL, patch=str(other), order=4)[1]) == 6


@pytest.mark.parametrize("cut", [1, 30])
def test_a_torn_last_line_is_rendered_again(tmp_path, cut):
    swept(tmp_path, NEAR)
    path = tmp_path / "index.csv"
    before = path.read_bytes()
    path.write_bytes(before[:-cut])
    (tmp_path / f".{NAMES[2]}.1.part").write_bytes(b"half")
    assert swept(tmp_path, NEAR)[1] == [3]
    assert path.read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_a_point_that_is_no_patch_fails_by_itself(tmp_path):
    """The ends are good, but what lies between is not: a body cannot be drawn to itself."""
    found, given = swept(tmp_path, "contact.glass.on=bell,marble", "body.bell.mass=0.1,0.2")
    assert (found.done, found.failed, given) == (2, 2, [1, 2])
    assert "contact[0].on: " in rows(tmp_path)[2]["status"]


def test_after_an_interrupt_it_goes_on(tmp_path):
    first, given = swept(tmp_path / "a", NEAR, most=1)
    assert (first.interrupted, first.done, first.exit_code, given) == (True, 1, 130, [1])
    assert [row["status"] for row in rows(tmp_path / "a")] == ["done"]
    second, given = swept(tmp_path / "a", NEAR)
    assert (second.done, second.already_done, given) == (3, 1, [2, 3])
    swept(tmp_path / "b", NEAR)
    assert (tmp_path / "a" / "index.csv").read_bytes() == (tmp_path / "b" / "index.csv").read_bytes()


@pytest.mark.hard
def test_a_sweep_that_is_stopped_and_killed_ends_as_one_that_is_not(tmp_path):
    """Ctrl-C, then kill -9, each half-way; the processes end too, and the index is the same in the end."""
    many = "body.marble.displacement=1e-4..1e-3:log:40"
    words = [sys.executable, str(ROOT / "render.py"), "sweep", MARBLE, "--vary", many, "--seconds", "0.5", "-o"]
    for number, expected in ((signal.SIGINT, 130), (signal.SIGKILL, -9)):
        before = len(rows(tmp_path / "a")) if (tmp_path / "a").exists() else 0
        run = subprocess.Popen([*words, str(tmp_path / "a")], stderr=subprocess.PIPE, text=True)
        until(lambda before=before: (tmp_path / "a" / "index.csv").exists() and len(rows(tmp_path / "a")) >= before + 3)
        children = psutil.Process(run.pid).children(recursive=True)
        os.kill(run.pid, number)
        _, said = run.communicate(timeout=20)
        assert run.returncode == expected
        assert "Traceback" not in said
        if number == signal.SIGINT:
            assert f"{len(rows(tmp_path / 'a'))} of 40 done; run the same command to continue" in said
        assert children and not psutil.wait_procs(children, timeout=10)[1]
        found = rows(tmp_path / "a")
        assert before < len(found) < 40
        assert len({row["number"] for row in found}) == len(found)
        assert all((tmp_path / "a" / "unscaled" / row["file"]).is_file() for row in found)
    held = len(rows(tmp_path / "a"))
    plain = dict.fromkeys(ACCURACY_OPTIONS)
    assert swept(tmp_path / "a", many, seconds=0.5, **plain)[0].already_done == held
    swept(tmp_path / "b", many, seconds=0.5, **plain)
    assert (tmp_path / "a" / "index.csv").read_bytes() == (tmp_path / "b" / "index.csv").read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 41


def until(reached, patience: float = 60.0) -> None:
    """Wait until something is so."""
    end = time.perf_counter() + patience
    while not reached():
        assert time.perf_counter() < end, "it took too long"
        time.sleep(0.02)


def marbles(count: int, seconds: float) -> list[RenderTask]:
    """The points of a sweep."""
    made = plan(f"body.marble.displacement=1e-4..1e-3:log:{count}")
    options = {"seconds": seconds, "samplerate": 44_100}
    return [RenderTask(n, made.scene(p).model_dump(exclude_unset=True), options) for n, p in enumerate(made.points, 1)]


def workers() -> list[psutil.Process]:
    """Those of this process that render."""
    return [c for c in psutil.Process().children() if "spawn_main" in " ".join(c.cmdline())]


@pytest.mark.hard
@pytest.mark.parametrize("seconds", [0.5, 20.0])
def test_a_process_that_is_killed_loses_no_point(seconds):
    """While it renders; or in the midst of a long answer, that waits to be read."""
    found = []
    for answer in run_local(marbles(30 if seconds < 1 else 5, seconds), 2):
        if answer is not None:
            found.append(answer)
            if len(found) == 3:
                time.sleep(0.0 if seconds < 1 else 3.0)
                workers()[-1].kill()
    assert sorted(number for number, _ in found) == list(range(1, 31 if seconds < 1 else 6))
    assert all(answer.audio is not None for _, answer in found)


@pytest.mark.hard
def test_who_is_stopped_in_the_midst_of_an_answer_ends():
    answers = run_local(marbles(5, 20.0), 2)
    while next(answers) is None:
        pass
    next(answers)
    time.sleep(3.0)  # more than one point takes
    held = workers()
    answers.close()
    assert held and not psutil.wait_procs(held, timeout=10)[1]


class Deadly:
    """Whoever unpickles this is no more."""

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.hard
def test_a_point_that_kills_its_process_fails_by_itself():
    first, second, third = marbles(3, 0.5)
    deadly = dataclasses.replace(second, options=second.options | {"seconds": Deadly()})
    found = dict(answer for answer in run_local([first, deadly, third], 2) if answer is not None)
    assert found[1].audio is not None and found[3].audio is not None
    assert found[2].audio is None and "its process was killed" in found[2].error


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture
def cluster(tmp_path):
    """The address of a scheduler; a function that starts a worker, in a folder of its own; and one that starts a
    sweep there, as a program of its own."""
    address = f"tcp://127.0.0.1:{free_port()}"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    quiet = {"env": environment, "cwd": tmp_path, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    started: list[subprocess.Popen] = []

    def dask(*words, engine=ROOT):
        told = quiet | {"env": environment | {"PYTHONPATH": str(engine)}}
        started.append(subprocess.Popen([sys.executable, "-m", "dask", *words, "--no-dashboard"], **told))
        return started[-1]

    def worker(name, engine=ROOT):
        plain = ["--nthreads", "1", "--no-nanny", "--host", "127.0.0.1"]
        return dask("worker", address, *plain, "--local-directory", str(tmp_path / name), engine=engine)

    def sweep(*words):
        command = [sys.executable, str(ROOT / "render.py"), "sweep", *words, "--cluster", address]
        started.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        return started[-1]

    dask("scheduler", "--host", "127.0.0.1", "--port", address.rpartition(":")[2])
    yield worker, sweep
    for process in started:
        process.kill()
        process.wait()


def come_to(folder, points, run):
    """Wait until so many points of a sweep are in its index, or it is over."""
    until(lambda: run.poll() is not None or ((folder / "index.csv").exists() and len(rows(folder)) >= points), 60.0)


def is_progress(line: str) -> bool:
    """Whether a line says how far a sweep is, how long it will take, or that its sounds go on."""
    return "% done" in line or ": about " in line or "sounds are cut" in line


@pytest.mark.hard
def test_workers_of_a_cluster_render_the_same_and_one_may_be_killed(tmp_path, cluster):
    """A scheduler and two workers, in folders of their own; one is killed half-way. Nothing is lost or done twice."""
    worker, sweep = cluster
    many = "body.marble.displacement=1e-4..1e-3:log:40"
    _, second = worker("one"), worker("two")
    time.sleep(3.0)
    run = sweep(MARBLE, "--vary", many, "--seconds", "2", "-o", str(tmp_path / "a"))
    come_to(tmp_path / "a", 5, run)
    second.kill()
    assert len(rows(tmp_path / "a")) < 40
    _, said = run.communicate(timeout=60)
    assert run.returncode == 0 and all(is_progress(line) for line in said.splitlines())
    plain = dict.fromkeys(ACCURACY_OPTIONS)
    swept(tmp_path / "b", many, seconds=2.0, **plain)
    assert (tmp_path / "a" / "index.csv").read_bytes() == (tmp_path / "b" / "index.csv").read_bytes()
    for row in rows(tmp_path / "a"):
        one, other = (soundfile.read(tmp_path / name / row["file"])[0] for name in "ab")
        np.testing.assert_array_equal(one, other)


@pytest.mark.hard
def test_when_all_workers_are_gone_it_is_said_and_others_may_come(tmp_path, cluster):
    worker, sweep = cluster
    first = worker("one")
    many = "body.marble.displacement=1e-4..1e-3:log:60"
    run = sweep(MARBLE, "--vary", many, "--seconds", "5", "-o", str(tmp_path / "a"))
    come_to(tmp_path / "a", 3, run)
    first.kill()
    assert len(rows(tmp_path / "a")) < 60
    said = next(line for line in run.stderr if not is_progress(line))
    assert "all workers are gone; waiting for others" in said
    worker("two")
    _, said = run.communicate(timeout=60)
    other_lines = [line for line in said.splitlines() if not is_progress(line)]
    assert (run.returncode, other_lines) == (0, [])
    assert len(rows(tmp_path / "a")) == 60


@pytest.mark.hard
def test_workers_of_another_engine_are_left_out(tmp_path, cluster):
    """Alone, they end the sweep; beside one of this engine, that renders all points."""
    worker, sweep = cluster
    other = tmp_path / "elsewhere"
    shutil.copytree(ROOT / "engine", other / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    (other / "engine" / "analysis" / "features.py").open("a").write("\n# another\n")
    worker("other", other)
    time.sleep(3.0)
    words = [MARBLE, "--vary", NEAR, "--seconds", "0.1", "-o", str(tmp_path / "a")]
    run = sweep(*words)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 1 and "Traceback" not in said
    assert (
        "no worker can take points; these workers are left out, because they have another version of the engine than "
        in said
    )
    assert said.count("\n") == 1 and re.search(r"tcp://127.0.0.1:\d+ \([0-9a-f]{12}\)$", said)
    assert rows(tmp_path / "a") == []
    worker("one")
    time.sleep(3.0)
    run = sweep(*words)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 0 and said.startswith("these workers are left out, because they have another")
    assert [row["status"] for row in rows(tmp_path / "a")] == ["done"] * 3


@pytest.mark.hard
def test_where_there_is_no_scheduler_it_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("engine.sweep.dask_workers.SCHEDULER_TIMEOUT", 1)
    begin = time.perf_counter()
    words = ["--vary", NEAR, "-o", str(tmp_path / "a"), "--cluster", f"127.0.0.1:{free_port()}"]
    assert main.main(["sweep", MARBLE, *words]) == 1
    assert "no scheduler answers at 127.0.0.1:" in capsys.readouterr().err
    assert time.perf_counter() - begin < 60.0  # it gives up by itself, on a busy machine too


def test_files_of_forces_go_with_the_task(tmp_path, monkeypatch):
    """A worker without the patch's folder renders the same; other contents of a file are another point."""
    ball = (ROOT / "patches" / "driven_ball.toml").read_text("utf-8")
    text = ball[: ball.index("[[force]]")] if "[[force]]" in ball else ball
    soundfile.write(tmp_path / "push.wav", np.sin(np.arange(400) / 9), 44_100, subtype="DOUBLE")
    name = tomllib.loads(text)["body"][0]["name"]
    force = f'[[force]]\nkind = "file"\nbody = "{name}"\nfile = "push.wav"\namplitude = 1.0\n'
    pickup = "" if "[[pickup]]" in text else f'[[pickup]]\nbody = "{name}"\n'
    (tmp_path / "p.toml").write_text(f"{text}\n{force}{pickup}", "utf-8")
    scene = engine.load(tmp_path / "p.toml")
    task = RenderTask(1, scene.model_dump(exclude_unset=True), {"seconds": SECONDS, "samplerate": 44_100})
    whole, print_ = task.complete(), task.fingerprint()
    expected = engine.render(scene, seconds=SECONDS).audio
    assert expected.any()
    soundfile.write(tmp_path / "push.wav", np.zeros(400), 44_100)
    assert task.fingerprint() != print_
    (tmp_path / "push.wav").unlink()
    np.testing.assert_array_equal(render_task(whole).audio, expected)
    assert "push.wav" in render_task(task).error


def test_rows_are_of_one_line_each():
    assert index_csv.csv_line([index_csv.format_cell(cell) for cell in (1, 0.1, None, "a,\nb")]) == '1,0.1,,"a, b"\n'


@pytest.mark.hard
def test_rows_that_are_none_of_ours_do_not_count(tmp_path):
    """A huge cell, a file that lies elsewhere, one without a name, numbers beyond all bounds: rendered again."""
    swept(tmp_path / "a", NEAR)
    path = tmp_path / "a" / "index.csv"
    before = path.read_bytes()
    head, *lines = path.read_text("utf-8").splitlines(keepends=True)
    first = NAMES[0]
    (tmp_path / first).write_bytes((tmp_path / "a" / first).read_bytes())
    elsewhere = [str(tmp_path / first), f"../{first}", f"{first}\0", "x" * 200_000, f"./{first}", NAMES[1]]
    for name in elsewhere:
        path.write_text(head + lines[0].replace(first, name) + "".join(lines[1:]), "utf-8")
        assert swept(tmp_path / "a", NEAR)[1] == [1]
        assert path.read_bytes() == before
    for line in ("9" * 5000 + lines[0], "\0" * 9 + "\n", '"\n', "1,2\n", "\udcff" * 3 + "\n", "a\rb\n"):
        path.write_text(head + line + "".join(lines), "utf-8", "surrogateescape", newline="")
        assert swept(tmp_path / "a", NEAR)[1] == []
        assert path.read_bytes() == before


@pytest.mark.hard
def test_a_sound_that_is_no_longer_one_is_rendered_again(tmp_path):
    """Emptied, cut, garbage of the same length, or of another rate."""
    swept(tmp_path, NEAR)
    path = tmp_path / NAMES[1]
    before = path.read_bytes()
    other = tmp_path / "other.wav"
    soundfile.write(other, np.zeros(882), 48_000, subtype="FLOAT")
    for damaged in (b"", before[:-100], before[:20], b"x" * len(before), other.read_bytes()):
        path.write_bytes(damaged)
        assert swept(tmp_path, NEAR)[1] == [2]
        assert soundfile.info(path).frames == 882
    assert swept(tmp_path, NEAR)[1] == []


def test_a_sound_that_is_gone_at_the_end_is_not_done(tmp_path, capsys):
    class Thief(Alone):
        def __call__(self, tasks):
            for answer in super().__call__(tasks):
                (tmp_path / "unscaled" / NAMES[0]).unlink(missing_ok=True)
                yield answer

    options = {"seconds": SECONDS, "samplerate": 44_100}
    found = run_sweep(plan(NEAR), tmp_path, Thief(), options)
    assert (found.done, found.gone, found.exit_code) == (2, 1, 1)
    console.print_sweep(found.as_dict(tmp_path))
    said = capsys.readouterr()
    assert said.out.startswith("2 of 3 done") and "1 sounds have been removed since" in said.err
    assert swept(tmp_path, NEAR)[1] == [1]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_an_index_that_is_a_pipe_is_not_waited_for(tmp_path, capsys):
    os.mkfifo(tmp_path / "index.csv")
    assert main.main(["sweep", MARBLE, "-o", str(tmp_path), "--vary", NEAR]) == 2
    assert "is an index of something else" in capsys.readouterr().err
