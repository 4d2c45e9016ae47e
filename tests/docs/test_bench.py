"""What the bench says of times."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from bench.performance import block_times, pairs, scaling, turns
from bench.publish import compare, stale
from bench.publish.report import stamp
from bench.scenes.families import bank
from engine.compiler.shipped import ABOUT, archive, read_about, read_part, write_members
from engine.compiler.targets import target_named


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


@pytest.mark.hard
def test_an_unknown_measurement_is_named_and_the_one_that_was_meant():
    run = bench("realtme")
    assert run.returncode == 2 and run.stderr == "bench: unknown realtme; did you mean realtime?\n"


@pytest.mark.hard
def test_without_a_name_the_names_are_listed_with_a_line_each():
    """Nothing is measured; each line says what its table is of."""
    run = bench()
    lines = run.stdout.splitlines()
    assert run.returncode == 0 and all(len(line) <= 120 for line in lines)
    listed = dict(line.split(maxsplit=1) for line in lines[lines.index("") + 1 :])
    assert {"realtime", "price", "ruler", "api", "compare", "golden"} <= set(listed)
    assert all(len(text) > 20 for text in listed.values())


CAPTION = "`uv run python -m bench start`, 2026-11-23, AMD EPYC, 2 cores, Python 3.11.7, numba 0.68.1, numpy 2.4.6"


def page(*captions: str) -> str:
    """A page with a table for each caption, and a summary."""
    tables = [f"<!-- bench:t{n} -->\n| a |\n\n{text}\n<!-- /bench:t{n} -->" for n, text in enumerate(captions)]
    return "\n\n".join(["<!-- older kernels -->\n<!-- /older kernels -->", *tables, "the end"])


def test_tables_of_other_kernels_are_marked_until_they_are_made_again():
    present, other = f"{CAPTION}, kernels 0123abcd", f"{CAPTION}, kernels 98765432"
    marked = stale.mark_older(page(present, other, CAPTION), "0123abcd")
    assert f"{present}\n" in marked and f"{other}{stale.MARK}\n" in marked and f"{CAPTION}{stale.MARK}\n" in marked
    assert "2 of the 3 tables of this page were measured with older kernels" in marked and "`start`" in marked
    assert stale.mark_older(marked, "0123abcd") == marked
    marked = stale.mark_older(page(present).replace(present, present + stale.MARK), "0123abcd")
    assert stale.MARK not in marked and "All 1 tables" in marked


def test_pages_mark_the_tables_of_older_kernels():
    """Fails if a table passes for one of the present kernels and is not, or the other way round: mended by
    `uv run python -m bench stale --mark`, without a measurement."""
    pages = stale.marked_pages()
    assert any(stale.tables_of(path.read_text("utf-8")) for path in pages)
    for path in pages:
        text = path.read_text("utf-8")
        assert stale.mark_older(text, stale.present_kernels()) == text, path


def test_every_published_table_has_a_caption_and_a_new_one_names_its_kernels():
    for path in (ROOT / "README.md", *stale.marked_pages()):
        text = path.read_text("utf-8")
        assert len(stale.tables_of(text)) == text.count("<!-- bench:"), path
    assert stale.KERNELS.search(stamp("start"))[1] == stale.measured_kernels()


def test_kernels_are_named_by_their_machine_code_and_not_by_their_sources(tmp_path):
    """A comment in a source gives an archive of other sources with the same code; one other byte of code is another."""
    shipped = archive(target_named("linux-x86-64-v3"))
    about = read_about(shipped)
    code = {part: read_part(shipped, part).machine_code for part in about["parts"]}

    def digits(name: str, about: dict, code: dict[str, bytes]) -> str:
        write_members(tmp_path / name, {ABOUT: json.dumps(about).encode(), **code})
        return stale.present_kernels(tmp_path / name)

    assert digits("commented", about | {"sources": "0" * 64}, code) == stale.present_kernels()
    first = next(iter(code))
    changed = code | {first: code[first][:-1] + bytes([code[first][-1] ^ 1])}
    assert digits("changed", about, changed) != stale.present_kernels()


def test_a_table_of_sources_without_archives_is_not_taken_for_one_of_the_archives(monkeypatch):
    monkeypatch.setattr(stale.cache, "source_digest", lambda: "0123abcd" + 56 * "0")
    assert stale.measured_kernels() == "0123abcd" != stale.present_kernels()


def test_a_run_that_was_stopped_goes_on_with_what_is_not_finished(tmp_path, monkeypatch):
    finished = f"{CAPTION}, kernels {stale.present_kernels()}"
    other = f"{CAPTION}, kernels 98765432".replace("bench start", "bench price")
    half = finished.replace("bench start", "bench price")
    (tmp_path / "README.md").write_text(page(half), "utf-8")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "bench.md").write_text(page(finished, other), "utf-8")
    monkeypatch.setattr(stale, "ROOT", tmp_path)
    assert [name for name in ("start", "price", "api") if stale.is_finished(name)] == ["start"]


def test_older_tables_are_listed(capsys):
    assert stale.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + len(list(stale.older_tables())) and lines[-1].endswith(stale.present_kernels())
    assert stale.main(["--fix"]) == 2


def test_a_size_is_extrapolated_only_where_costs_lead_to_one():
    """Costs in ns per sample, at 44.1 kHz: 22676 ns are there."""
    sizes = [1, 4, 16, 64]
    assert scaling.largest(sizes, [100.0 * n for n in sizes]) == "about 230"
    assert scaling.largest(sizes, [100.0, 300.0, 250.0, 240.0]) == "more than 64"
    assert scaling.largest(sizes, [100.0, 103.0, 110.0, 140.0]) == "more than 64"
    assert scaling.largest(sizes, [1e3, 4e3, 16e3, 64e3]) == "22"
    assert scaling.largest(sizes, [1e5, 2e5, 3e5, 4e5]) == "fewer than 1"


def test_times_are_medians_of_runs_in_turn_and_what_spreads_too_far_is_measured_again():
    """What delays a turn meets all that is compared, and a median is none the worse for it."""
    order, delays = [], iter([0.0, 5.0, 0.0] + 9 * [0.0])

    def work(name: str, seconds: float):
        def run() -> float:
            order.append(name)
            return seconds

        return run

    one, two = turns.time_in_turn(work("a", 1e-6), work("b", 3e-6), turns=5)
    assert order == 5 * ["a", "b"] and (one.median, two.median) == (1e-6, 3e-6) and one.spread == two.spread == 0.0
    assert two.nanoseconds == "3000 ± 0 %"
    (delayed,) = turns.time_in_turn(lambda: 1.0 + next(delays), turns=3)
    assert delayed == turns.Timing(1.0, 1.0, 0.0) and len(list(delays)) == 6  # a second try was enough
    restless = iter([1.0, 3.0, 5.0, 1.0, 2.0, 3.0, 1.0, 4.0, 9.0])
    (kept,) = turns.time_in_turn(lambda: next(restless), turns=3)
    assert not list(restless) and kept.median == 2.0  # of all tries the one that spread least


def test_what_is_timed_moves_and_gives_the_same_samples_in_each_turn():
    """Also modes that nothing strikes: they would sleep."""
    replay = turns.Replay(bank(8), 0.02)
    replay()
    first = replay.audio.copy()
    replay()
    assert np.all(np.std(first[:882], axis=0) > 0.0) and np.array_equal(replay.audio, first)


class Clockwork:
    """A version of the engine that takes `ns` per sample; in each turn, something else delays another block."""

    def __init__(self, ns: float, refuses: bool = False) -> None:
        self.tree, self.ns, self.refuses, self.turn = Path("new"), ns, refuses, 0

    def ask(self, seconds: float, frames: int, **_: object) -> dict:
        if self.refuses:
            return {"refused": "no such key"}
        times = np.full(-(-round(seconds * pairs.RATE) // frames), frames * self.ns * 1e-9)
        times[self.turn % times.size] += 0.1
        self.turn += 1
        return {"times": times.tolist(), "error": 1e-15, "capped": 0}


def test_what_delays_some_blocks_does_not_change_the_ratio_of_two_versions():
    old, new = pairs.measure([Clockwork(1000.0), Clockwork(1250.0)], {}, 1.0, 4)
    assert new.ns / old.ns == pytest.approx(1.25) and old.ns == pytest.approx(1000.0, rel=0.03)
    assert "1.250" in pairs.row("ball", old, new)
    assert pairs.summary([[old, new], [new, old], [old, old]]).endswith("of 3: 1.000")
    assert pairs.warning([[old, new], [new, old]]) == ""
    assert pairs.warning([[old, new], [old, new], [old, old]]).startswith("warning: this version takes 1.16 of")
    assert "refused by the new version: no such key" in pairs.measure(
        [Clockwork(1.0), Clockwork(1.0, True)], {}, 1.0, 4
    )


def test_a_block_takes_about_a_millisecond_where_it_can():
    assert [pairs.frames_of_block(ns) for ns in (5.0, 1000.0, 8500.0, 1e6)] == [8192, 1024, 128, 64]


def test_each_render_that_is_timed_has_the_same_samples(patch):
    """Also where events change the model, as the bow's do."""
    performance = block_times.Performance(patch("bowed_violin").model_dump(mode="json", exclude_unset=True), 0.1)
    performance.render(1024)
    first = performance.audio.copy()
    performance.render(256)
    assert np.any(first) and np.array_equal(first, performance.audio)


@pytest.mark.hard
def test_pairs_are_of_two_versions_and_of_patches_that_there_are(capsys):
    for words in ([], ["HEAD", "HEAD", "HEAD"]):
        with pytest.raises(SystemExit) as end:
            pairs.main(words)
        assert end.value.code == 2
    assert pairs.main(["HEAD", "--only=no_such_patch"]) == 2
    assert pairs.main(["no-such-revision"]) == 2
    assert "no_such_patch" in capsys.readouterr().err
    assert len(pairs.documents(ROOT / "patches", [], 3)) == 3
