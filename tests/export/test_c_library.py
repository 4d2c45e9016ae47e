"""A patch in C: its samples are those of `engine.render`, with nothing but a C compiler and the C library."""

import shutil
import subprocess

import numpy as np
import pytest

import engine
from engine.cli.main import main
from engine.export.c_library import export_c
from engine.export.faults import CannotExport
from engine.export.scene_bytes import SceneBytes

COMPILER = shutil.which("cc")
ARM_COMPILER, EMULATOR = shutil.which("aarch64-linux-gnu-gcc"), shutil.which("qemu-aarch64")
SECONDS = 0.2
PATCHES = ["repelled_oscillator", "piano_c4", "marimba"]


def samples_in_c(folder, scene, compiler, runner=()):
    """Compile the example of a library, and return what it writes, [frames, channels], and the energy error it says."""
    program = folder / "program"
    sources = [folder / file for file in ("main.c", "fdh.c", "fdh_patch.o")]
    subprocess.run([*compiler, "-O2", "-Wall", "-Wextra", "-Werror", "-o", program, *sources, "-lm"], check=True)
    ran = subprocess.run([*runner, program], check=True, capture_output=True)
    return np.frombuffer(ran.stdout).reshape(-1, scene.channels), float(ran.stderr.split()[-1])


@pytest.mark.hard
@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("name", PATCHES)
def test_the_samples_in_c_are_those_of_the_engine(name, tmp_path):
    scene = engine.load(name)
    export_c(scene, tmp_path, seconds=SECONDS)
    audio, error = samples_in_c(tmp_path, scene, [COMPILER])
    np.testing.assert_array_equal(audio, engine.render(scene, seconds=SECONDS, cores=1).audio)
    assert error < 1e-12


@pytest.mark.slow
@pytest.mark.skipif(None in (ARM_COMPILER, EMULATOR), reason="Debian: gcc-aarch64-linux-gnu, qemu-user")
@pytest.mark.parametrize("name", PATCHES)
def test_another_processor_computes_the_same_samples(name, tmp_path):
    """An emulator of 64-bit ARM, whose C library is another build."""
    scene = engine.load(name)
    export_c(scene, tmp_path, target="aarch64-linux", seconds=SECONDS)
    audio, error = samples_in_c(tmp_path, scene, [ARM_COMPILER, "-static"], [EMULATOR])
    np.testing.assert_array_equal(audio, engine.render(scene, seconds=SECONDS, cores=1).audio)
    assert error < 1e-12


def test_each_pointer_of_a_narrow_machine_is_where_its_compiler_looks():
    """Two arrays, nothing and a truth value, for pointers of four bytes and of eight."""
    a, b = np.arange(3.0), np.arange(4).reshape(2, 2)
    for width, places in ((4, (24, 88)), (8, (32, 96))):
        laid_out = SceneBytes(width)
        laid_out.add("value", (a, (None, b), True))
        begin = laid_out.values["value"]
        assert laid_out.pointers[0] == begin + places[0]
        for place, array in zip(laid_out.pointers, (a, b), strict=True):
            at = int.from_bytes(laid_out.content[place : place + width], "little")
            assert at == laid_out.place_of(array)
            np.testing.assert_array_equal(np.frombuffer(laid_out.content, array.dtype, array.size, at), array.ravel())


def test_what_cannot_be_exported_is_said_before_anything_is_made(tmp_path):
    scene = engine.load("barrier_linear")
    coarse = scene.model_copy(update={"accuracy": scene.accuracy.replace(oversample=2)})
    with pytest.raises(CannotExport, match="oversample"):
        export_c(coarse, tmp_path / "c")
    with pytest.raises(ValueError, match="no target is called 'vax'; there are x86_64-linux"):
        export_c(scene, tmp_path / "c", "vax")
    assert not (tmp_path / "c").exists()


def test_bad_options_of_the_command_are_said_at_once(tmp_path, capsys):
    assert main(["export", "barrier_linear", "--c", str(tmp_path / "none" / "c"), "--target", "vax"]) == 2
    said = capsys.readouterr().err
    assert "the folder that it would be in is not there" in said and "no target is called 'vax'" in said
