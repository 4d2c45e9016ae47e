"""The scorer: what it says of a trajectory, of one that is wrong, and of none."""

import numpy as np
import pytest

from bench.ruler import contact_ruler
from bench.ruler.contact_ruler.__main__ import main
from bench.ruler.contact_ruler.library import VERSION
from bench.ruler.contact_ruler.score import energy_error, pull_of
from bench.ruler.engine_method import simulate_by_engine
from engine.cli.main import main as run_engine


@pytest.fixture
def known() -> contact_ruler.Trajectory:
    """The reference of a problem, as a trajectory."""
    _, reference = contact_ruler.load_problem("repelled_oscillator")
    return contact_ruler.Trajectory(reference.displacement, reference.force[:, None], energy=reference.energy)


def test_the_reference_itself_has_no_error(known):
    row = contact_ruler.score(*contact_ruler.load_problem("repelled_oscillator"), known)
    assert row.motion == row.force == row.bands_db == row.pull == 0.0
    assert row.energy <= 1e-14


def test_errors_are_those_that_were_made(known):
    problem, reference = contact_ruler.load_problem("repelled_oscillator")
    wrong = known._replace(displacement=1.01 * known.displacement, force=0.97 * known.force, energy=None)
    row = contact_ruler.score(problem, reference, wrong)
    assert row.motion == pytest.approx(0.01)
    assert row.force == pytest.approx(0.03)
    assert row.bands_db == pytest.approx(20 * np.log10(1.01))
    assert np.isnan(row.energy)


def test_the_energy_is_judged_by_its_change_or_its_rise(known):
    problem, reference = contact_ruler.load_problem("repelled_oscillator")
    falling = known._replace(energy=known.energy * np.linspace(1.0, 0.5, len(known.energy)))
    assert energy_error(problem, reference, falling) == pytest.approx(0.5)
    lossy, reference = contact_ruler.load_problem("lossy_bounce")
    energy = np.linspace(1.0, 0.5, lossy.frames + 1) * reference.energy.max()
    falling = contact_ruler.Trajectory(reference.displacement, reference.force[:, None], energy=energy)
    assert energy_error(lossy, reference, falling) == 0.0
    energy = energy.copy()
    energy[100:] += 0.2 * reference.energy.max()
    assert energy_error(lossy, reference, falling._replace(energy=energy)) == pytest.approx(0.2, rel=1e-2)


def test_a_pull_is_a_share_of_the_largest_push():
    assert pull_of(np.array([[1.0, 2.0], [-0.5, 0.0]])) == 0.25
    assert pull_of(np.zeros((3, 1))) == 0.0


def test_a_bow_supplies_energy_and_may_pull():
    problem, reference = contact_ruler.load_problem("bowed_string")
    right = contact_ruler.Trajectory(reference.displacement, reference.force[:, None], energy=reference.energy)
    row = contact_ruler.score(problem, reference, right)
    assert row.motion == row.force == 0.0
    assert np.isnan(row.energy) and np.isnan(row.pull)  # of contacts, of which it has none


def test_what_blows_up_is_said_to(known):
    row = contact_ruler.score(
        *contact_ruler.load_problem("repelled_oscillator"), known._replace(displacement=1e9 * known.displacement)
    )
    assert row.failed == "blows up" and np.isnan(row.motion)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["barrier", "hammer_c4", "walls"])
def test_the_engine_is_near_the_references(name):
    problem, reference = contact_ruler.load_problem(name)
    once, fine = (
        contact_ruler.score(problem, reference, simulate_by_engine(name, "general", order=4, substeps=n))
        for n in (1, 8)
    )
    assert once.motion <= {"barrier": 1e-11, "hammer_c4": 1e-4, "walls": 2e-3}[name]
    assert fine.motion <= {"barrier": 1e-13, "hammer_c4": 2e-6, "walls": 1e-6}[name]
    assert fine.force <= 1e-5 and fine.pull == 0.0 and fine.energy <= 1e-13


@pytest.mark.hard
def test_an_exact_energy_is_not_an_exact_motion():
    row = contact_ruler.score(
        *contact_ruler.load_problem("walls"), simulate_by_engine("walls", "general", order=2, substeps=1)
    )
    assert row.energy <= 1e-13
    assert 0.1 < row.motion < 0.2


def test_the_command_lists_and_scores(tmp_path, capsys, known):
    assert main([]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(contact_ruler.NAMES)
    assert main(["repelled_oscillator"]) == 0
    assert "can be predicted" in capsys.readouterr().out
    mine = tmp_path / "mine.npz"
    np.savez(mine, displacement=known.displacement)
    assert main(["repelled_oscillator", str(mine)]) == 0
    measured = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert measured["motion"] == "0" and measured["force"] == "nan"
    assert main(["repelled_oscillator", str(mine), "a method", "me"]) == 0
    assert capsys.readouterr().out.startswith(f"{VERSION},repelled_oscillator,a method,,me,")
    np.savez(mine, displacement=1e9 * known.displacement)
    assert main(["repelled_oscillator", str(mine)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "blows up"


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
    assert main(["repelled_oscillator", str(tmp_path / "mine.npz")]) == 2
    assert message in capsys.readouterr().err


def test_the_command_says_what_is_no_problem_and_no_file(tmp_path, capsys):
    assert main(["hamer_c4"]) == 2
    assert "did you mean hammer_c4?" in capsys.readouterr().err
    assert main(["walls", str(tmp_path / "none.npz")]) == 2
    assert "cannot be read as .npz" in capsys.readouterr().err
    assert main(["walls", "mine.npz", "a method"]) == 2
    assert "METHOD AUTHOR" in capsys.readouterr().err


def test_the_command_says_what_is_wrong_with_files_that_are_not_npz(tmp_path, capsys, known):
    np.save(tmp_path / "array.npy", known.displacement)
    np.savez(tmp_path / "good.npz", displacement=known.displacement)
    damaged = bytearray((tmp_path / "good.npz").read_bytes())
    damaged[6] |= 1  # says that it is encrypted
    damaged[damaged.find(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "locked.npz").write_bytes(damaged)
    (tmp_path / "text.npz").write_text("hello\n")
    for name in ("array.npy", "locked.npz", "text.npz", ""):
        assert main(["repelled_oscillator", str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert "cannot be read as .npz" in error and error.count("\n") == 1


@pytest.mark.parametrize("words", [["score"], ["score", "hammer_c4", "mine.npz"], ["score", "--json"]])
def test_the_engine_says_where_its_scorer_went(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_engine(words) == 2
    assert capsys.readouterr().err.endswith(
        'no command, file or shipped patch is called "score"; the problems and their scorer are a package of their own,'
        " contact_ruler: see docs/ruler.md\n"
    )
