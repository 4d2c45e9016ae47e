"""Plug-ins as files: bundles, damaged data, other systems, and what kernels leave of what instances share."""

import json
import random
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import lief
import numpy as np
import pytest
from conftest import mostly_hard

import engine
from engine.api.page import level_of
from engine.cli.main import main
from engine.export.plugin_data import HEAD_WORDS, SECTION_WORDS, Section
from engine.export.plugin_library import BUILDS, link_library, write_sources
from tests.compiler.test_shipped import skip_if_stale
from tests.export.key_messages import RATE, TWO_TINES, midi_of
from tests.export.lv2_host import Lv2Plugin
from tests.export.plugins import is_same, needs_linker, play_live, write_plugin
from tests.live.two_ways import Message

pytestmark = needs_linker
DRIVER, GCC = Path(__file__).with_name("plugin_driver.c"), shutil.which("gcc")
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
MUTATIONS = 10_000
SONG = [
    Message(0, "on", 60, 64),
    Message(700, "on", 64, 127),
    Message(5000, "off", 60, 64),
    Message(9000, "off", 64, 64),
]
FRAMES = 12_000
needs_gcc = pytest.mark.skipif(GCC is None or sys.platform != "linux", reason="no gcc for Linux")


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    """A program that plays data files, under sanitizers."""
    skip_if_stale()
    folder = tmp_path_factory.mktemp("driver")
    inputs = write_sources(folder, {3: "linux-x86-64-v3"})
    strict = ["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    subprocess.run(
        [GCC, *strict, *SANITIZERS, f"-I{folder}", "-o", folder / "driver", DRIVER, *inputs, "-lm"], check=True
    )
    return folder / "driver"


def run_driver(driver, paths, rate=RATE, seconds=300):
    """Return a line for each file; it must not stop before."""
    done = subprocess.run(
        [driver, str(rate)], input="\n".join(map(str, paths)), capture_output=True, text=True, timeout=seconds
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.splitlines()


# --- what is written


def test_a_musicians_path_works_as_typed(tmp_path, capsys):
    """`fdh export PATCH --plugin ~/.clap` and `~/.lv2`: what hosts look for, and the same samples in both."""
    patch = tmp_path / "two_tines.toml"
    patch.write_text(toml_of(TWO_TINES), "utf-8")
    for folder in (".clap", ".lv2"):
        assert main(["export", str(patch), "--plugin", str(tmp_path / folder), "--rates", "44100", "--json"]) == 0
        files = json.loads(capsys.readouterr().out)["files"]
        assert files == [str(tmp_path / folder / f"two_tines{folder}")]
    bundle, scene = tmp_path / ".lv2" / "two_tines.lv2", engine.load(patch)
    expected = play_live(scene, RATE, scene.level_factor, SONG, FRAMES)
    events = [(m.frame, midi_of(m.kind, m.key, m.value)) for m in SONG]
    for blocks in [(64,), (1, 1024, 77)]:
        plugin = Lv2Plugin(bundle, "fdh.so", RATE, 1)
        plugin.control(2, -1.0)  # latency
        plugin.control(3, -1.0)  # lost events
        assert is_same(plugin.render(FRAMES, events, blocks), expected)
        assert plugin.controls[2].value == plugin.controls[3].value == 0.0
        plugin.close()


def toml_of(document):
    """Return a document as TOML, by the library that patches are written with."""
    import tomlkit

    return tomlkit.dumps(document)


def test_a_port_of_lv2_is_a_live_parameter(tmp_path):
    scene = engine.load("piano_c4")
    assert main(["export", "piano_c4", "--plugin", str(tmp_path), "--format", "lv2", "--rates", "44100"]) == 0
    bundle = tmp_path / "piano_c4.lv2"
    text = (bundle / "patch.ttl").read_text("utf-8")
    name = f'"{scene.labels["contact.felt.stiffness"]}"'
    assert name in text and "pprops:logarithmic" in text
    stiffness = 2.0 * scene.contact[0].stiffness
    port = next(n for n, line in enumerate(text.split("lv2:index ")) if name in line) - 1
    gain = level_of(scene, RATE)
    plugin = Lv2Plugin(bundle, "fdh.so", RATE, scene.channels)
    plugin.control(port, float(np.float32(stiffness)))
    audio = plugin.render(FRAMES, [(100, midi_of("on", 36, 64))], (64,))
    messages = [Message(0, "set", "contact.felt.stiffness", float(np.float32(stiffness))), Message(100, "on", 36, 64)]
    assert is_same(audio, play_live(scene, RATE, gain, messages, FRAMES))


def test_the_validator_of_lv2_finds_nothing(tmp_path):
    if not all(map(shutil.which, ("lv2_validate", "sord_validate"))):
        pytest.skip("the packages lv2-dev and sordi are not there")
    hostile = TWO_TINES | {"title": 'A "title" \\ with → marks', "author": "Zoë\n", "licence": "CC BY 4.0 <x>"}
    patch = tmp_path / "tines.toml"
    patch.write_text(toml_of(hostile), "utf-8")
    assert main(["export", str(patch), "--plugin", str(tmp_path), "--format", "lv2", "--rates", "44100"]) == 0
    files = [tmp_path / "tines.lv2" / name for name in ("manifest.ttl", "patch.ttl")]
    said = subprocess.run(["lv2_validate", *files], capture_output=True, text=True)
    assert said.returncode == 0 and "Found 0 errors" in said.stdout + said.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--format", "vst"], "--format: no format is called 'vst'; there are clap, lv2, vst3"),
        (["--system", "beos"], "--system: no system is called 'beos'"),
        (["--rates", "44k"], "--rates: '44k' is no list of sample rates; 44100,48000 is one"),
        (["--rates", "12"], "12 Hz is no sample rate of a plug-in"),
        (["--samplerate", "44100"], "--samplerate: a plug-in has several; give --rates 44100,48000"),
        (["-o", "a.html"], "-o: a plug-in takes none"),
        (["--slide", "body.nobody.frequency"], "body.nobody.frequency"),
    ],
)
def test_wrong_options_are_said_in_a_line(words, says, tmp_path, capsys):
    assert main(["export", "bouncing_ball", "--plugin", str(tmp_path / "out"), *words]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1 and not (tmp_path / "out").exists()


def test_without_the_linker_its_package_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["export", "bouncing_ball", "--plugin", str(tmp_path)]) == 2
    assert "pip install 'fdh-engine[plugin]'" in capsys.readouterr().err


@pytest.mark.hard
@pytest.mark.parametrize("plugin_format", ["clap", "lv2"])
@pytest.mark.parametrize("system", list(BUILDS))
def test_a_library_for_every_system_has_what_hosts_look_for(system, plugin_format):
    """It needs nothing but the C library, and shows nothing but its entry."""
    skip_if_stale()
    entry = {"clap": "clap_entry", "lv2": "lv2_lib_descriptor"}[plugin_format]
    content = link_library(system, plugin_format)
    whole = lief.MachO.parse(list(content)) if system == "macos" else [lief.parse(list(content))]
    parsed = list(whole)
    assert len(parsed) == len(BUILDS[system])
    for library in parsed:
        if system == "windows":
            assert [one.name for one in library.get_export().entries] == [entry]
        else:
            assert any(entry in symbol.name for symbol in library.exported_symbols)
    assert len(content) < 4e6


def test_the_bundles_of_macos_and_windows(tmp_path, monkeypatch):
    """Where each file lies; the libraries are tested elsewhere."""
    monkeypatch.setattr("engine.export.plugin.link_library", lambda *arguments: b"library")
    assert main(["export", "bouncing_ball", "--plugin", str(tmp_path), "--system", "all", "--rates", "48000"]) == 0
    files = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    contents = "macos/bouncing_ball.clap/Contents"
    assert {
        f"{contents}/MacOS/bouncing_ball",
        f"{contents}/Resources/bouncing_ball.fdh",
        f"{contents}/Info.plist",
        "macos/bouncing_ball.lv2/fdh.dylib",
        "windows/bouncing_ball.clap",
        "windows/bouncing_ball.fdh",
        "windows/bouncing_ball.lv2/fdh.dll",
        "linux/bouncing_ball.lv2/fdh.so",
        "linux/bouncing_ball.lv2/patch.fdh",
        "linux-aarch64/bouncing_ball.clap",
    } <= files


# --- what is read


NAMES = [
    "tines",
    "bouncing_ball",
    "piano_c4",
    "violin",
    "guitar",
    "toms",
    "sitar",
    "snare_wires",
    "kalimba",
    "slack_bass",
]


@needs_gcc
@pytest.mark.parametrize("name", mostly_hard(NAMES, "tines"))
def test_kernels_leave_what_instances_share_as_it_is(name, driver, tmp_path):
    """After notes, pedals, the wheel and every slider; nothing is out of bounds, and a reset begins anew."""
    plugin = write_plugin(engine.load(TWO_TINES if name == "tines" else name), tmp_path)
    (said,) = run_driver(driver, [plugin.data])
    assert said.startswith("played, 0 changed, ") and "not again" not in said


@needs_gcc
@pytest.mark.parametrize("rate", [RATE, 88_200])
def test_nothing_is_allocated_while_it_plays(rate, tmp_path):
    """Neither by notes, pedals and sliders nor by a reset, nor where it is resampled."""
    skip_if_stale()
    inputs, wrapped = write_sources(tmp_path, {3: "linux-x86-64-v3"}), ("malloc", "calloc", "realloc", "free")
    flags = [f"-I{tmp_path}", "-DFDH_COUNT", *(f"-Wl,--wrap={name}" for name in wrapped)]
    subprocess.run([GCC, "-O1", *flags, "-o", tmp_path / "driver", DRIVER, *inputs, "-lm"], check=True)
    plugin = write_plugin(engine.load("piano_c4"), tmp_path)
    (said,) = run_driver(tmp_path / "driver", [plugin.data], rate)
    assert said.startswith("played, 0 changed, 0 calls, ")


@needs_gcc
@pytest.mark.hard
def test_damaged_files_are_refused(driver, tmp_path):
    """10 000 files, of which bytes are changed, cut off or others', and where what this code reads is changed together
    with its checksums: each is refused or played, under sanitizers."""
    good = write_plugin(engine.load(TWO_TINES), tmp_path).data.read_bytes()
    rng, count = random.Random(4), 0
    said = {"refused": 0, "played": 0}
    while count < MUTATIONS:
        paths = []
        for n in range(500):
            paths.append(tmp_path / f"{n}.fdh")
            paths[-1].write_bytes(mutate(good, rng))
        lines = run_driver(driver, paths)
        assert len(lines) == 500
        for line in lines:
            said[line.partition(":")[0].partition(",")[0]] += 1
        count += len(lines)
    assert said["refused"] > 0.8 * MUTATIONS and said["played"] > 0


READ_BY_US = (Section.NUMBERS, Section.TEXTS, Section.LEVELS, Section.KEYS, Section.CONTROLS, Section.POSITIONS)


def mutate(good, rng):
    """Return a damaged file."""
    content, kind = bytearray(good), rng.randrange(5)
    if kind == 0:
        return bytes(content[: rng.randrange(len(content))])
    if kind == 1:
        return rng.randbytes(rng.randrange(3000))
    if kind == 2:
        return crafted(good, rng)
    place = rng.randrange(len(content)) if kind == 3 else rng.randrange(8 * (HEAD_WORDS + 12 * SECTION_WORDS))
    for n in range(rng.choice((1, 1, 8))):
        content[(place + n) % len(content)] ^= rng.randrange(1, 256)
    return bytes(content)


def crafted(good, rng):
    """Return a file in which numbers that the player itself reads are others, with checksums that fit."""
    words = np.frombuffer(good, np.int64).copy()
    sections = words[HEAD_WORDS : HEAD_WORDS + SECTION_WORDS * int(words[4])].reshape(-1, SECTION_WORDS)
    chosen = rng.choice([n for n, section in enumerate(sections) if section[0] in READ_BY_US and section[4]])
    parts = []
    for n, section in enumerate(sections):
        packed = good[section[2] : section[2] + section[3]]
        if n == chosen:
            planes = np.frombuffer(zlib.decompress(packed, -15), np.uint8).reshape(8, -1)
            numbers = np.frombuffer(planes.T.tobytes(), np.int64).copy()
            for _ in range(rng.choice((1, 3))):
                value = rng.choice([-1, 0, 1, 7, 1 << 31, -(1 << 62), (1 << 63) - 1, rng.randrange(1 << 62)])
                numbers[rng.randrange(len(numbers))] = value
            raw = numbers.tobytes()
            packer = zlib.compressobj(1, zlib.DEFLATED, -15)
            packed = packer.compress(np.frombuffer(raw, np.uint8).reshape(-1, 8).T.tobytes()) + packer.flush()
            packed += bytes(-len(packed) % 8)
            section[3], section[5], section[6] = len(packed), zlib.crc32(packed), zlib.crc32(raw)
        parts.append(packed)
    place = 8 * (HEAD_WORDS + sections.size)
    for section, part in zip(sections, parts, strict=True):
        section[2] = place
        place += len(part)
    listed = sections.tobytes()
    words[2], words[5] = place, zlib.crc32(listed)
    return words[:HEAD_WORDS].tobytes() + listed + b"".join(parts)


def test_the_head_of_a_file_is_as_documented(tmp_path):
    """Magic, version, length, kernels, sections."""
    content = write_plugin(engine.load("bouncing_ball"), tmp_path).data.read_bytes()
    magic, version, length, _, sections, checksum = struct.unpack("<8s5q", content[:48])
    begin = 8 * HEAD_WORDS
    assert (magic, version, length) == (b"FDHPLUG1", 1, len(content))
    assert checksum == zlib.crc32(content[begin : begin + 8 * SECTION_WORDS * sections])
