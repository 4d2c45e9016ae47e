"""`fdh doctor`: one page of what this machine is, whatever is missing or broken on it."""

import json
import os
import platform
import subprocess
import sys

import pytest
from conftest import ROOT

from engine.assembly import table_digest
from engine.cli import doctor_command, main
from engine.compiler import cache, shipped
from engine.compiler.kernel_origin import KernelOrigin, find_origin
from engine.compiler.targets import target_named
from engine.live.audio_device import NO_PORTAUDIO, DeviceError
from engine.live.midi_drivers import MidiError
from engine.runtime.job_memory import RENDER_BLOCK

SECTIONS = ["system", "versions", "blas", "kernel", "cache", "tables", "audio", "midi", "cost"]
PUBLISHED = {"bouncing_ball": "0123456789abcdef", "piano_c4": "fedcba9876543210"}


@pytest.fixture
def two_patches(monkeypatch):
    """Two shipped patches, of which one has the published tables."""
    monkeypatch.setattr(table_digest, "read_shipped_digests", lambda: PUBLISHED)
    monkeypatch.setattr(table_digest, "digest_scene", lambda scene: PUBLISHED["bouncing_ball"])


@pytest.fixture
def device(monkeypatch):
    """A device, and no MIDI port."""
    monkeypatch.setattr("engine.live.audio_device.output_devices", lambda: [(3, "Desk", 2, 48_000)])
    monkeypatch.setattr("engine.live.midi_drivers.list_ports", list)


def run(*words: str, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess:
    command = [sys.executable, str(ROOT / "render.py"), "doctor", *words]
    settings = os.environ | (environment or {})
    return subprocess.run(command, env=settings, capture_output=True, text=True, timeout=300, check=False)


def test_a_page_has_a_line_for_each_section(two_patches, device, capsys):
    assert main.main(["doctor"]) == 0
    page = capsys.readouterr().out
    lines = page.splitlines()
    assert [line.split()[0] for line in lines if line[0] != " "] == SECTIONS and len(lines) < 25
    assert platform.python_version() in page and f"numpy {cache.package_version('numpy')}" in page
    assert cache.source_digest()[:8] in page and "piano_c4 runs on the general kernel" in page
    assert "1 of 2 shipped patches have the published tables, bit for bit; not piano_c4" in page
    assert "Desk: 2 channels, 48000 Hz" in page and "there is no port" in page
    assert "not known" not in page


def test_json_has_the_same(two_patches, device, capsys):
    assert main.main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert list(report) == SECTIONS
    assert report["tables"] == {"patches": 2, "same": 1, "different": ["piano_c4"]}
    assert report["audio"] == {"devices": [{"name": "Desk", "channels": 2, "samplerate": 48_000}]}
    assert report["kernel"]["kernel"] == "general"
    assert report["kernel"]["origin"] in [*KernelOrigin]
    cost = report["cost"]
    if report["kernel"]["origin"] == KernelOrigin.COMPILER:
        assert cost == {"error": "not compiled"}
    else:
        assert 1.0 < cost["ns_per_sample"] < 1e5  # of a sample that flies free, 8
        assert cost["real_time_factor"] == pytest.approx(1e9 / 44_100 / cost["ns_per_sample"])


def test_patches_that_differ_are_named(monkeypatch, device, capsys, patch):
    """Beside others that are built as renderings build them."""
    here = {name: table_digest.digest_scene(patch(name)) for name in ("bouncing_ball", "piano_c4", "tanpura")}
    monkeypatch.setattr(table_digest, "read_shipped_digests", lambda: here | {"tanpura": "0" * 16})
    assert main.main(["doctor", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert tables == {"patches": 3, "same": 2, "different": ["tanpura"]}


def test_what_is_missing_for_live_sound_is_named(two_patches, monkeypatch, capsys):
    """PortAudio, or the package that brings it; and the driver of ports."""

    def fail(error: Exception) -> None:
        raise error

    monkeypatch.setattr("engine.live.audio_device.output_devices", lambda: fail(DeviceError(NO_PORTAUDIO)))
    monkeypatch.setattr("engine.live.midi_drivers.list_ports", lambda: fail(MidiError("a MIDI port needs a driver")))
    assert main.main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    missing = "the PortAudio library is not installed; rendering to a file does not need it"
    assert report["audio"] == {"error": missing} and report["midi"] == {"error": "a MIDI port needs a driver"}
    monkeypatch.setattr("engine.live.audio_device.output_devices", lambda: fail(ImportError("No module sounddevice")))
    assert main.main(["doctor"]) == 0
    page = capsys.readouterr().out
    assert "audio        not known: No module sounddevice\n" in page and page.splitlines()[-1].startswith("cost ")


@pytest.mark.hard
def test_without_portaudio_and_drivers_of_ports_all_else_is_printed(tmp_path):
    """In a process of its own, which also names neither the user nor the machine."""
    home = tmp_path / "someone"
    home.mkdir()
    (tmp_path / "sounddevice.py").write_text("raise OSError('PortAudio library not found')\n")
    (tmp_path / "rtmidi.py").write_text("raise ImportError('no driver')\n")
    environment = {"PYTHONPATH": str(tmp_path), "HOME": str(home), "XDG_CACHE_HOME": str(home / "kernels")}
    done = run(environment=environment)
    assert done.returncode == 0, done.stderr
    lines = {line.split()[0]: line for line in done.stdout.splitlines() if line[0] != " "}
    assert list(lines) == SECTIONS
    assert "not known: the PortAudio library is not installed" in lines["audio"]
    assert "not known: a MIDI port needs python-rtmidi" in lines["midi"]
    assert "~/kernels" in lines["cache"] and "someone" not in done.stdout
    assert [name for name in lines if "not known" in lines[name]] == ["audio", "midi"]
    assert platform.node() not in done.stdout.split()


@pytest.mark.parametrize("name", SECTIONS)
def test_what_fails_says_why_and_the_rest_is_printed(name, monkeypatch, capsys):
    def fail() -> doctor_command.Section:
        raise RuntimeError("the moon is full\nand more")

    calm = {other: lambda: doctor_command.Section({"fine": True}, "fine") for other in SECTIONS}
    monkeypatch.setattr(doctor_command, "SECTIONS", calm | {name: fail})
    assert main.main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[SECTIONS.index(name)].endswith(" not known: the moon is full")
    assert sum(line.endswith(" fine") for line in lines) == len(SECTIONS) - 1
    assert main.main(["doctor", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[name] == {"error": "the moon is full"}


@pytest.mark.parametrize(
    ("kept", "shipped_code", "origin"),
    [("code", "code", "cache"), (None, "code", "shipped"), (None, None, "compiler")],
)
def test_the_origin_of_a_kernel_is_where_it_would_be_loaded_from(kept, shipped_code, origin, monkeypatch):
    monkeypatch.setattr("engine.compiler.kernel_origin.load_stored", lambda *_: kept)
    monkeypatch.setattr("engine.compiler.kernel_origin.load_shipped", lambda *_: shipped_code)
    assert find_origin(RENDER_BLOCK, ()) == origin


def test_why_no_archive_fits_is_said(monkeypatch):
    best = shipped.archive(target_named("linux-x86-64-v3"))
    monkeypatch.setattr(shipped, "fitting_archive", lambda: best)
    assert shipped.explain_choice() == "linux-x86-64-v3.tar.xz"
    monkeypatch.setattr(shipped, "fitting_archive", lambda: None)
    monkeypatch.setattr(shipped, "fitting_targets", lambda: [target_named("linux-x86-64-v3")])
    monkeypatch.setattr(shipped, "sources_of", lambda _: "other sources")
    assert shipped.explain_choice() == "the shipped archives were made from other sources"
    monkeypatch.setattr(shipped, "sources_of", lambda _: cache.source_digest())
    monkeypatch.setattr(shipped, "result_of_trial", lambda _: "no sound within 10 s")
    assert shipped.explain_choice() == "linux-x86-64-v3.tar.xz failed its trial on this machine: no sound within 10 s"
    monkeypatch.setattr(shipped, "fitting_targets", list)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    assert shipped.explain_choice() == "no archive is shipped for linux on riscv64"


def test_levels_of_processors(monkeypatch):
    import llvmlite.binding

    from engine.compiler.processor_level import X86_LEVELS, describe_level

    features: dict[str, bool] = {}
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert describe_level() == "x86-64"
    for name, needed in X86_LEVELS:
        features |= dict.fromkeys(needed[1:], True)
        assert describe_level() != name
        features |= dict.fromkeys(needed, True)
        assert describe_level() == name
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    features.clear()
    assert describe_level() == "aarch64"
    features |= {"neon": True, "lse": True}
    assert describe_level() == "aarch64 with neon, lse"
