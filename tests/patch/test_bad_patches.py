"""Whatever a patch file holds, it is refused in lines that say where and what, or it renders; and at once."""

import contextlib
import math
import os
import random
import re
import signal
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import PATCHES, ROOT, mostly_hard
from fuzzing import mutated

import engine
from engine.analysis.profile import kernel_id
from engine.assembly.build import build
from engine.assembly.external_forces import force_table
from engine.bodies.sheet import MAX_SHEET_MODES
from engine.cli import main
from engine.faults import BuildError
from engine.live.player import Player
from engine.offline.simulation import Simulation
from engine.patch import reader
from engine.patch.toml_lines import locate_keys, nearest_line, split_statements
from engine.report import console

ODD = sorted((ROOT / "tests" / "patch" / "bad_patches").glob("*.toml"))
AT_ONCE = 8.0  # s of processor time: most take a hundredth of one
MASS = '[[body]]\nname = "b"\nkind = "mass"\nmass = 1.0\nvelocity = 1.0\n[[pickup]]\nbody = "b"\n'
STRING = '[[body]]\nname = "s"\nkind = "string"\nlength = 1.0\nlinear_density = 1e-3\ntension = 50.0\n'
HEARD = '[[pickup]]\nbody = "s"\nat = 0.5\n'
PUSH = '[[force]]\nbody = "b"\nkind = "file"\namplitude = 1.0\nfile = "{}"\n'
MEASURED = '[[body]]\nname = "s"\nkind = "modes"\nfile = "{}"\n' + HEARD
CONTACT = '[[contact]]\nbody = "s"\nstiffness = 1e6\nexponent = 1.5\n'

DEEP = ":1: tables, lists or dotted keys go deeper than 32"
NO_CSV = "cannot be read as CSV "


def many(count: int, text: str) -> str:
    """A text many times, with the number of each in the place of %."""
    return "".join(text.replace("%", str(i)) for i in range(count))


# what is too large to be kept: the text, and a part of what is said first
LARGE = {
    "nested": ("a = " + "[" * 5000 + "]" * 5000, DEEP),
    "nested tables": ("a = " + "{a = " * 50_000, DEEP),
    "dotted key": (".".join(["a"] * 100_000) + " = 1\n", DEEP),
    "dotted header": ("[" + ".".join(["a"] * 100_000) + "]\n", DEEP),
    "dotted key inside": ("a = {" + ".".join(['"a"'] * 100_000) + " = 1}\n", DEEP),
    "digits": (MASS + "x = [1,\n" + "9" * 5000 + "]\n", ":9: a number of over 4000 digits"),
    "lines of a list": (
        STRING + "t60 = [\n" + "1.0,\n" * 3000 + "]\n" + HEARD + "x = 1\n",
        ":7 body[0].t60: the list has 3000 items",
    ),
    "one list": (STRING + "t60 = [" + "true," * 150_000 + "]\n" + HEARD, ":7 body[0].t60: the list has 150000 items"),
    "places": (
        STRING + HEARD + CONTACT + "barrier = 0.0\nat = [" + "0.1," * 99_999 + "]\n",
        "99999 positions; at most 512",
    ),
    "keys": (many(30_000, "a% = 1\n") + MASS, ":1 a0: unknown key; the known ones are"),
    "key": ("a" * 900_000 + " = 1\n" + MASS, ":1 " + "a" * 77 + "...: unknown key"),
    "text": ('x = "' + "a\\n" * 300_000 + '"\n' + MASS, ":1 x: unknown key"),
    "bodies": (many(20_000, '[[body]]\nname = "a%"\nkind = "x"\n'), ":1 body: the list has 20000 items"),
    "kinds": (many(4999, '[[body]]\nname = "a%"\nkind = "x%"\n'), ":3 body[0].kind: unknown kind"),
    "misspelt": (many(4999, '[[body]]\nname = "a%"\nkind = "mass"\nmas = 1.0\n'), ":4 body[0].mas: unknown key"),
    "names": (many(4999, '[[contact]]\nbody = "z%"\nstiffness = 1.0\nexponent = 1.0\n') + MASS, 'is named "z0"'),
    "points": (MEASURED.format("p.csv"), NO_CSV + "(it has 20001 columns; at most 10000)"),
    "patch": ("#" * 1_100_000, ": is larger than 1 MB; give a patch"),
    "cell": (MEASURED.format("cell.csv"), NO_CSV + "(field larger than field limit"),
    "table": (MEASURED.format("big.csv"), NO_CSV + "(is larger than 16 MB)"),
    "file name": (MASS + PUSH.format("a" * 5000), ":12 force[0].file: cannot be read as audio (file name too long)"),
    "name": (MASS.replace('"b"', '"' + "b" * 5000 + '"'), "String should have at most 64 characters"),
    "events": (
        MASS + many(4999, '[[event]]\ntime = 9.0\nkind = "strike"\nbody = "b"\nvelocity = 1.0\n'),
        "after the end",
    ),
}


def stem(path: Path) -> str:
    return path.stem


def told(words: list[str], capsys: pytest.CaptureFixture[str], code: int = 2) -> list[str]:
    """What a command says on standard error, at once."""
    begin = time.process_time()
    assert main.main(words) == code, capsys.readouterr()
    assert time.process_time() - begin < AT_ONCE
    lines = capsys.readouterr().err.splitlines()
    assert all(len(line) < 1000 and line.isprintable() for line in lines) and len(lines) <= reader.MAX_FAULTS_LISTED + 1
    return lines


@pytest.mark.hard_for("rigid_joint_that_begins_apart", "too_many_points_in_an_island")
@pytest.mark.parametrize("path", mostly_hard(ODD, *(path for path in ODD if "good" not in path.stem)), ids=stem)
def test_check_and_render_agree(path, tmp_path, capsys):
    """The first line of each patch says what is said of it."""
    wanted = path.read_text("utf-8").partition("\n")[0].removeprefix("# ") or ": empty"
    good = wanted == "good"
    begin = time.process_time()
    code, checked = main.main(["check", str(path)]), capsys.readouterr()
    assert time.process_time() - begin < AT_ONCE
    assert code == (0 if good else 2) and not (good and checked.err), checked
    assert good or any(wanted in line for line in checked.err.splitlines()), checked.err
    out = tmp_path / "a.wav"
    assert main.main([str(path), "-o", str(out), "--seconds", "0.02"] if good else [str(path), "-o", str(out)]) == code
    assert out.exists() == good
    assert good or capsys.readouterr().err == checked.err
    assert main.main(["params", str(path)]) in ((0,) if good else (0, 2))


@pytest.mark.hard_but("dotted header", "dotted key", "dotted key inside", "nested", "nested tables", "cell")
@pytest.mark.parametrize("name", LARGE)
def test_what_is_too_large_is_refused_at_once(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("cell.csv").write_text("frequency,p\n" + "1" * 200_000 + ",1\n")
    Path("p.csv").write_text("frequency" + ",p" * 20_000 + "\n" + "1," * 20_000 + "1\n")
    with open("big.csv", "wb") as file:
        file.truncate(17_000_000)
    text, says = LARGE[name]
    Path("p.toml").write_text(text, "utf-8")
    lines = told(["check", "p.toml"], capsys)
    assert lines[0].startswith("p.toml") and says in lines[0]
    assert lines == told(["p.toml", "-o", "a.wav"], capsys) == told(["params", "p.toml"], capsys)


def test_of_very_many_faults_the_first_are_told(tmp_path, capsys):
    """And how many more there are."""
    (tmp_path / "p.toml").write_text(MASS + "".join(f"a{i} = 1\n" for i in range(70)))
    lines = told(["check", str(tmp_path / "p.toml")], capsys)
    assert [line.partition(": ")[0].rpartition(".")[2] for line in lines[:-1]] == [f"a{i}" for i in range(50)]
    assert lines[-1].endswith("p.toml: and 20 more errors; these are the first")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_pipes_and_devices_are_not_waited_for(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    for name in ("pipe", "/dev/zero"):
        what = "is not a file, but a pipe, a device or a folder"
        assert told(["check", name], capsys) == [f"{name}: {what}; give a patch, a .toml file of at most 1 MB"]
        for patch in (MEASURED.format(name), MASS + PUSH.format(name)):
            Path("p.toml").write_text(patch)
            (line,) = told(["check", "p.toml"], capsys)
            assert what in line
    with open(os.open("pipe", os.O_RDWR), "wb"):  # it has a writer, who writes nothing
        assert len(told(["check", "pipe"], capsys)) == 1


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "x" * 5000 + ".toml", "x/" * 3000, "\udcff.toml", ""])
def test_names_that_no_file_has(name, capsys):
    lines = told(["check", name], capsys)
    assert len(lines) == 1 and lines[0].startswith(name[:9].replace("\0", r"\x00").replace("\udcff", r"\udcff"))
    if name and name.isprintable():
        assert told([name], capsys)
        assert main.main(["new", name]) in (1, 2)
        assert len(capsys.readouterr().err) < 2000


def test_force_files_that_cannot_push(tmp_path, monkeypatch, capsys):
    """Cut off, at no sample rate, or with what is not a number; check and render say the same."""
    monkeypatch.chdir(tmp_path)
    noise = np.random.default_rng(1).uniform(-0.5, 0.5, 40_000)
    soundfile.write("cut.flac", noise, 44_100)
    Path("cut.flac").write_bytes(Path("cut.flac").read_bytes()[:20_000])
    soundfile.write("slow.wav", noise, 1)
    soundfile.write("nan.wav", np.append(noise, np.nan), 44_100, subtype="FLOAT")
    Path("noise.raw").write_bytes(b"noise")
    for name, says in {
        "cut.flac": "cannot be read as audio",
        "slow.wav": "its sample rate is 1 Hz, not 4000 to 768000",
        "nan.wav": "not all of its samples are numbers",
        "noise.raw": "cannot be read as audio",
    }.items():
        Path("p.toml").write_text(MASS + PUSH.format(name))
        (line,) = told(["check", "p.toml"], capsys)
        assert re.match(r"p\.toml:(8|12) force\[0\]\.file: ", line), line
        assert says in line
        assert told(["p.toml", "-o", "a.wav"], capsys) == [line]


# --- where statements begin


def slowly(text: str) -> dict[tuple[str | int, ...], int]:
    """Line of every key and table, found by reading on until a statement is one: right, and slow."""
    rows, lines, table, counts, i = text.split("\n"), {(): 1}, (), {}, 0
    while i < len(rows):
        for end in range(i + 1, len(rows) + 1):
            with contextlib.suppress(tomllib.TOMLDecodeError):
                statement = tomllib.loads("\n".join(rows[i:end]))
                break
        if rows[i].lstrip().startswith("["):
            table, value = (), statement
            while isinstance(value, dict) and value:
                key, value = next(iter(value.items()))
                table += (key,)
                if isinstance(value, list):
                    counts[table] = counts.get(table, -1) + 1
                    value = value[0]
                if table in counts:
                    table += (counts[table],)
            lines.setdefault(table, i + 1)
            if isinstance(table[-1], int):
                lines.setdefault(table[:-1], i + 1)
        else:
            for path in paths(statement):
                lines.setdefault(table + path, i + 1)
        i = end
    return lines


def paths(value: object) -> Iterator[tuple[str | int, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (key,)
        yield from ((key, *rest) for rest in paths(inner))


TANGLED = '''x = """a\\"""
[b]
"""""
y = \'\'\'
[[c]] = "\'\'\'  # c
[ "q#]".r ] # [x]
 "=" = [ "]", # ]
  { a = "}" }, ]
[[ a . 'b' ]]
z.w.v = 1
z.w.u = 2
[[a.b]]
[a.b.c]
d = { e = { f = "=" } }  # g = 1
'''


@pytest.mark.parametrize("text", [*(p.read_text("utf-8") for p in PATCHES), TANGLED, TANGLED.replace("\n", "\r\n")])
def test_lines_are_those_that_reading_bit_by_bit_finds(text):
    found, wanted = locate_keys(text), slowly(text.replace("\r\n", "\n"))
    assert found and wanted
    assert all(wanted[where] == line for where, line in found.items())
    assert all(nearest_line(found, where) == line for where, line in wanted.items())


@pytest.mark.hard_for("text3", "text5", "text4")
@pytest.mark.parametrize(
    "text",
    ['"' + '\\"' * 300_000, '"""' + '""\\' * 200_000, "a" * 900_000, "[[" * 300_000, "='" * 300_000, "\n" * 600_000],
)
def test_what_is_no_toml_is_looked_through_at_once(text):
    begin = time.process_time()
    assert len(list(split_statements(text))) <= 1
    assert time.process_time() - begin < AT_ONCE


# --- what a render needs, and no more


def forced(seconds: float = 0.05, **force: float | str) -> engine.Scene:
    parts = {"body": "b", "kind": "pulse", "amplitude": 1.0, "duration": 3600.0} | force
    data = tomllib.loads(MASS) | {"seconds": seconds, "force": [parts]}
    return engine.Scene.model_validate(data)


@pytest.mark.hard
@pytest.mark.parametrize("kind", ["pulse", "half_sine", "pluck"])
def test_tables_of_forces_are_no_longer_than_the_render(kind):
    """Those of a sound without end are whole."""
    scene = forced(kind=kind)
    assert build(scene, 44_100, seconds=0.05).model.force.table.size < 0.06 * 44_100
    brief = forced(kind=kind, duration=2.0)
    assert build(brief, 44_100).model.force.table.size >= 2.0 * 44_100
    assert Player(brief, seconds=math.inf).model.force.table.size >= 2.0 * 44_100


@pytest.mark.parametrize("kind", ["pulse", "half_sine", "pluck", "sine", "noise", "file"])
def test_the_part_of_a_force_that_is_heard_is_the_same(kind, tmp_path, monkeypatch):
    """To the bit, also that of a file at another rate."""
    monkeypatch.chdir(tmp_path)
    soundfile.write("p.wav", np.random.default_rng(1).uniform(-0.5, 0.5, 96_000), 48_000, subtype="DOUBLE")
    more = {"file": "p.wav", "amplitude": 1.0} if kind == "file" else {"duration": 1.0}
    more |= {"frequency": 50.0} if kind == "sine" else {}
    if kind == "file":
        data = tomllib.loads(MASS) | {"force": [{"body": "b", "kind": "file", **more}]}
        force = engine.Scene.model_validate(data).force[0]
    else:
        force = forced(kind=kind, **more).force[0]
    whole, part = force_table(force, 44_100), force_table(force, 44_100, 0.1)
    assert 4410 <= part.values.size < 5000 < whole.values.size and part.start == whole.start
    assert np.array_equal(part.values[:4410], whole.values[:4410])


def test_forces_for_which_there_is_no_room_are_refused():
    scene = forced(3600.0)
    scene = scene.model_copy(update={"force": scene.force * 3})
    for seconds in (3600.0, math.inf):
        with pytest.raises(ValueError, match=r"force\[1\]: with this one, the forces last more than 6087 s in total"):
            build(scene, 44_100, seconds=seconds)


@pytest.mark.parametrize("shape", [{"radius": 0.18}, {"size": [0.3, 0.4]}])
def test_a_sheet_that_says_nothing_of_its_modes_has_the_lowest_thousand(shape):
    body = {"name": "s", "kind": "membrane", "area_density": 0.2, "frequency": 80.0} | shape

    def modes(**more: int) -> np.ndarray:
        pickup = [{"body": "s", "at": [0.5, 0.5]}]
        scene = engine.Scene.model_validate({"body": [body | more], "pickup": pickup})
        return build(scene, 44_100).layout.modal_bodies[0].omega

    assert np.array_equal(modes(), modes(modes=MAX_SHEET_MODES)) and modes().size == MAX_SHEET_MODES
    assert np.array_equal(modes(modes=2000)[:MAX_SHEET_MODES], modes())


@pytest.mark.hard
def test_a_drum_of_all_its_modes_is_built_soon():
    body = {"name": "s", "kind": "membrane", "area_density": 0.2, "frequency": 0.1, "radius": 1.0, "modes": 20_000}
    data = {"body": [body | {"name": f"s{i}"} for i in range(4)], "pickup": [{"body": "s0", "at": [0.5, 0.5]}]}
    begin = time.process_time()
    build(engine.Scene.model_validate(data), 44_100)
    assert time.process_time() - begin < 2 * AT_ONCE


@pytest.mark.hard
def test_many_bodies_that_touch_are_built_soon():
    """In time that grows as they do."""
    count = 2000
    body = [{"name": f"b{i}", "kind": "mass", "mass": 1.0, "velocity": 1.0} for i in range(count)]
    law = {"stiffness": 1e6, "exponent": 1.5}
    contact = [law | {"body": f"b{i}", "on": f"b{i + 1}", "gap": 1.0} for i in range(count - 1) if i % 400]
    begin = time.process_time()
    build(engine.Scene.model_validate({"body": body, "contact": contact, "pickup": [{"body": "b0"}]}), 44_100)
    assert time.process_time() - begin < 2 * AT_ONCE


@pytest.mark.parametrize("frequency", [5e-324, 1e-160, 1e-20])
def test_bodies_that_hardly_move_are_built_without_a_warning(frequency):
    body = {"name": "b", "kind": "oscillator", "mass": 1e-6, "frequency": frequency, "displacement": 1.0}
    contact = {"body": "b", "barrier": 2.0, "stiffness": 1e6, "exponent": 1.5}
    scene = engine.Scene.model_validate({"body": [body], "contact": [contact], "pickup": [{"body": "b"}]})
    model, state, _ = build(scene, 44_100)
    assert np.isfinite(model.step.kick).all() and np.isfinite(state.compression).all()


# --- what is said of speed


@pytest.mark.parametrize(
    ("modes", "contacts", "factor", "says"),
    [
        (13_832, 1, 0.39, "13832 modes and 1 contact points; about 4315 modes would be fast enough"),
        (80, 100, 0.25, "80 modes and 100 contact points; about 44 contact points would be fast enough"),
    ],
)
def test_too_slow_says_what_would_be_fast_enough(modes, contacts, factor, says):
    islands = {"count": 1, "largest": {"bodies": ["drum"], "modes": modes, "contacts": contacts}}
    assert console.explain_slowness(islands, factor).endswith(says)


@pytest.mark.parametrize(("factor", "says"), [(0.39, "0.39 ×"), (1.234, "1.2 ×"), (9.97, "10 ×"), (123.4, "123 ×")])
def test_slow_speeds_are_told_in_two_digits(factor, says):
    assert console.format_factor(factor) == says


# --- patches gone wrong at random


BUDGET = 600.0  # s, of which a kernel takes ten to compile
MOST_KINDS = 12  # kernels


class TooLong(Exception):
    """A patch took longer than any should."""


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Raises TooLong where it would take too long."""

    def ring(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, 2 * AT_ONCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.hard
@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarms")
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_mutated_patches_are_refused_or_render(seed, tmp_path):
    """A thousand for each seed. Those that are valid are built; a few samples are rendered by kernels that many
    share."""
    chance, end = random.Random(seed), time.monotonic() + BUDGET
    texts = [path.read_text("utf-8") for path in PATCHES]
    kinds: set[str] = set()
    outcomes: Counter[str] = Counter()
    path = tmp_path / "p.toml"
    for _ in range(1000):
        text = mutated(chance.choice(texts), chance)
        path.write_text(text, "utf-8", newline="")
        try:
            with at_once():
                scene = engine.load(path)
                outcomes["loaded"] += 1
                rate = 44_100 * scene.accuracy.oversample
                model, state, _ = build(scene, rate, seconds=scene.seconds)
        except (engine.PatchError, BuildError) as error:
            outcomes[type(error).__name__] += 1
            assert all(len(line) < 1000 for line in str(error).split("\n"))
            continue
        except BaseException:
            print(text)
            raise
        kind = kernel_id(model, state)
        if len(kinds) < MOST_KINDS and time.monotonic() < end:
            kinds.add(kind)
        if kind in kinds:
            audio = np.zeros((64, scene.channels))
            Simulation(model, state).render_block(audio)
            outcomes["rendered"] += 1
            assert np.isfinite(audio).all(), text
    assert outcomes["loaded"] > 100 and outcomes["rendered"] > 50, outcomes
