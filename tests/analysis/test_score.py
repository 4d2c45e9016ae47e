"""The scorer: what it says of a trajectory, of one that is wrong, and of none."""

import json

import numpy as np
import pytest

from bench.ruler.engine_method import simulate_by_engine
from engine import problems
from engine.cli.main import main
from engine.problems.score import energy_error, pull_of


@pytest.fixture
def known() -> problems.Trajectory:
    """The reference of a problem, as a trajectory."""
    _, reference = problems.load_problem("repelled_oscillator")
    return problems.Trajectory(reference.displacement, reference.force[:, None], energy=reference.energy)


def test_the_reference_itself_has_no_error(known):
    row = problems.score(*problems.load_problem("repelled_oscillator"), known)
    assert row.motion == row.force == row.bands_db == row.pull == 0.0
    assert row.energy <= 1e-14


def test_errors_are_those_that_were_made(known):
    problem, reference = problems.load_problem("repelled_oscillator")
    wrong = known._replace(displacement=1.01 * known.displacement, force=0.97 * known.force, energy=None)
    row = problems.score(problem, reference, wrong)
    assert row.motion == pytest.approx(0.01)
    assert row.force == pytest.approx(0.03)
    assert row.bands_db == pytest.approx(20 * np.log10(1.01))
    assert np.isnan(row.energy)


def test_the_energy_is_judged_by_its_change_or_its_rise(known):
    problem, reference = problems.load_problem("repelled_oscillator")
    falling = known._replace(energy=known.energy * np.linspace(1.0, 0.5, len(known.energy)))
    assert energy_error(problem, reference, falling) == pytest.approx(0.5)
    lossy, reference = problems.load_problem("lossy_bounce")
    energy = np.linspace(1.0, 0.5, lossy.frames + 1) * reference.energy.max()
    falling = problems.Trajectory(reference.displacement, reference.force[:, None], energy=energy)
    assert energy_error(lossy, reference, falling) == 0.0
    energy = energy.copy()
    energy[100:] += 0.2 * reference.energy.max()
    assert energy_error(lossy, reference, falling._replace(energy=energy)) == pytest.approx(0.2, rel=1e-2)


def test_a_pull_is_a_share_of_the_largest_push():
    assert pull_of(np.array([[1.0, 2.0], [-0.5, 0.0]])) == 0.25
    assert pull_of(np.zeros((3, 1))) == 0.0


def test_a_bow_supplies_energy_and_may_pull():
    problem, reference = problems.load_problem("bowed_string")
    right = problems.Trajectory(reference.displacement, reference.force[:, None], energy=reference.energy)
    row = problems.score(problem, reference, right)
    assert row.motion == row.force == 0.0
    assert np.isnan(row.energy) and np.isnan(row.pull)  # of contacts, of which it has none


def test_what_blows_up_is_said_to(known):
    row = problems.score(
        *problems.load_problem("repelled_oscillator"), known._replace(displacement=1e9 * known.displacement)
    )
    assert row.failed == "blows up" and np.isnan(row.motion)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["barrier", "hammer_c4", "walls"])
def test_the_engine_is_near_the_references(name):
    problem, reference = problems.load_problem(name)
    once, fine = (
        problems.score(problem, reference, simulate_by_engine(name, "general", order=4, substeps=n)) for n in (1, 8)
    )
    assert once.motion <= {"barrier": 1e-11, "hammer_c4": 1e-4, "walls": 2e-3}[name]
    assert fine.motion <= {"barrier": 1e-13, "hammer_c4": 2e-6, "walls": 1e-6}[name]
    assert fine.force <= 1e-5 and fine.pull == 0.0 and fine.energy <= 1e-13


@pytest.mark.hard
def test_an_exact_energy_is_not_an_exact_motion():
    row = problems.score(*problems.load_problem("walls"), simulate_by_engine("walls", "general", order=2, substeps=1))
    assert row.energy <= 1e-13
    assert 0.1 < row.motion < 0.2


def test_the_command_lists_gives_and_scores(tmp_path, capsys, known):
    assert main(["score", "--json"]) == 0
    assert [row["problem"] for row in json.loads(capsys.readouterr().out)] == list(problems.NAMES)
    copy, mine = tmp_path / "copy.npz", tmp_path / "mine.npz"
    assert main(["score", "repelled_oscillator", "-o", str(copy)]) == 0
    assert "horizon" in capsys.readouterr().out
    with np.load(copy) as data:
        np.savez(mine, displacement=data["reference_displacement"])
    assert main(["score", "repelled_oscillator", str(mine), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["motion"] == 0.0


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"displacement": np.zeros(3)}, "displacement is [3]; the shape must be [2206]"),
        ({"force": np.zeros((2205, 1))}, "has no array displacement"),
        ({"displacement": np.zeros(2206), "speed": np.zeros(1)}, "unknown array speed"),
        ({"displacement": np.zeros(2206), "q": np.zeros((2206, 1))}, "q without p"),
        ({"displacement": np.zeros(2206, complex)}, "complex128; it must be of floating-point"),
        ({"displacement": np.zeros(2206), "seconds": np.array("long")}, "seconds is not a number"),
    ],
)
def test_the_command_says_what_is_wrong_with_a_file(tmp_path, capsys, arrays, message):
    np.savez(tmp_path / "mine.npz", **arrays)
    assert main(["score", "repelled_oscillator", str(tmp_path / "mine.npz")]) == 2
    assert message in capsys.readouterr().err


def test_the_command_says_what_is_no_problem_and_no_file(tmp_path, capsys):
    assert main(["score", "hamer_c4"]) == 2
    assert "did you mean hammer_c4?" in capsys.readouterr().err
    assert main(["score", "walls", str(tmp_path / "none.npz")]) == 2
    assert "cannot be read as .npz" in capsys.readouterr().err


def test_the_command_says_what_is_wrong_with_files_that_are_not_npz(tmp_path, capsys, known):
    np.save(tmp_path / "array.npy", known.displacement)
    np.savez(tmp_path / "good.npz", displacement=known.displacement)
    damaged = bytearray((tmp_path / "good.npz").read_bytes())
    damaged[6] |= 1  # says that it is encrypted
    damaged[damaged.find(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "locked.npz").write_bytes(damaged)
    (tmp_path / "text.npz").write_text("hello\n")
    for name in ("array.npy", "locked.npz", "text.npz", ""):
        assert main(["score", "repelled_oscillator", str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert "cannot be read as .npz" in error and error.count("\n") == 1


def test_the_command_refuses_an_output_without_a_problem_or_over_the_trajectory(tmp_path, capsys, known):
    mine = tmp_path / "mine.npz"
    np.savez(mine, displacement=known.displacement)
    written = mine.read_bytes()
    assert main(["score", "repelled_oscillator", str(mine), "-o", str(mine)]) == 2
    assert mine.read_bytes() == written and "without a trajectory" in capsys.readouterr().err
    assert main(["score", "walls", "-o", "/dev/full"]) == 2
    assert "end it in .npz" in capsys.readouterr().err
    assert main(["score", "-o", str(tmp_path / "copy.npz")]) == 2
    assert "no problem is given" in capsys.readouterr().err
    assert main(["score", "walls", "-o", str(tmp_path / "none" / "copy.npz")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
