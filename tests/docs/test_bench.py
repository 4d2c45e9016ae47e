"""What the bench says of times."""

import subprocess
import sys

from conftest import ROOT

from bench.publish import compare


def test_what_moved_by_more_than_noise_is_marked():
    old = {"a": (10.0, 10.1), "b": (10.0, 12.0), "c": (10.0, 10.0), "d": (10.0, 10.0)}
    new = {"a": (11.0, 11.0), "b": (11.0, 11.0), "c": (9.0, 9.0), "e": (1.0, 1.0)}
    found = {name: moved for name, _, moved in compare.compared(old, new)}
    assert found == {"a": "SLOWER", "b": "", "c": "faster"}


def test_results_are_compared_from_folders_and_revisions(tmp_path, capsys):
    results = tmp_path / "results"
    results.mkdir()
    table = '"# made"\npatch,"ns per sample, least",median\nball,20.0,20.5\n'
    (results / "realtime.csv").write_text(table, "utf-8")
    (tmp_path / "slow").mkdir()
    (tmp_path / "slow" / "realtime.csv").write_text(table.replace("20", "40"), "utf-8")
    assert compare.main([str(results), str(results)]) == 0
    assert compare.main([str(results), str(tmp_path / "slow")]) == 1
    assert "2.000  SLOWER" in capsys.readouterr().out
    assert compare.main([str(results), "no-such-revision"]) == 2
    assert compare.main(["one"]) == 2


def bench(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "bench", *words], cwd=ROOT, capture_output=True, text=True, timeout=60)


def test_an_unknown_measurement_is_named_and_the_one_that_was_meant():
    run = bench("realtme")
    assert run.returncode == 2 and run.stderr == "bench: unknown realtme; did you mean realtime?\n"


def test_without_a_name_the_names_are_listed_with_a_line_each():
    """Nothing is measured; each line says what its table is of."""
    run = bench()
    lines = run.stdout.splitlines()
    assert run.returncode == 0 and all(len(line) <= 120 for line in lines)
    listed = dict(line.split(maxsplit=1) for line in lines[lines.index("") + 1 :])
    assert {"realtime", "price", "ruler", "api", "compare", "golden"} <= set(listed)
    assert all(len(text) > 20 for text in listed.values())
