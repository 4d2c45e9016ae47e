"""`uv run python -m bench machines [--samples] [--write]`: do the tables of the shipped patches depend on the machine?

Processes of their own compute them: one as `fdh render` does, and others that are made to take this processor for a
lesser one: NumPy without its code for x86-64-v4 and v3, OpenBLAS with that of other processors and with more threads,
the C library without fused multiply-adds. A row for each says how many patches have the committed digests
(patches/table_digests.txt), and which have not; with --samples, also the largest difference of their first half second,
as a share of the peak. A setting that cannot be had here is left out, and why. --write writes the digests of this
machine to that file instead.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.publish.report import ROOT
from engine.assembly.table_digest import SHIPPED_DIGESTS, read_shipped_digests
from engine.provenance import processor_name

BLAS_PROCESSORS = "Haswell", "SkylakeX", "Zen", "Sandybridge", "Prescott"
BLAS_THREADS = 1, 2
AS_RENDERED = {"OPENBLAS_NUM_THREADS": "1"}  # as engine.cli.main sets it
NO_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"}
BEYOND_V3 = "X86_V4", "AVX512"  # how the names of features begin, of all versions of NumPy
BEYOND_V2 = *BEYOND_V3, "X86_V3", "AVX", "F16C", "FMA"
LINE_LENGTH = 120

# Patches whose tables depend on the machine, and why; the test of digests leaves them out.
DEPENDS_ON_MACHINE: dict[str, str] = {
    "scraped_stick": "the C library: noise in a band is SciPy's filter and soxr's resampling",
}


class Setting(NamedTuple):
    """A setting that a process is started with."""

    name: str
    variables: dict[str, str]  # of the environment
    problem: str = ""  # why it cannot be had here


def settings(features: dict[str, list[str]]) -> list[Setting]:
    """The settings to try, with those that cannot be had. features: as of bench.accuracy.machine_tables"""
    without = [without_features("x86-64-v4", features, BEYOND_V3), without_features("x86-64-v3", features, BEYOND_V2)]
    blas = [Setting(f"OpenBLAS as {name}", {"OPENBLAS_CORETYPE": name}) for name in BLAS_PROCESSORS]
    threads = [Setting(f"OpenBLAS with {n} threads", {"OPENBLAS_NUM_THREADS": str(n)}) for n in BLAS_THREADS]
    return [*without, *blas, *threads, Setting("C library without FMA", NO_FMA)]


def without_features(level: str, features: dict[str, list[str]], beginnings: tuple[str, ...]) -> Setting:
    """NumPy without its code for a level, and for those above. beginnings: of the names of features"""
    name = f"NumPy without {level}"
    optional = [feature for feature in features["optional"] if feature.startswith(beginnings)]
    if not optional:
        return Setting(name, {}, "NumPy cannot do without, or has none")
    if not {*optional} & {*features["used"]}:
        return Setting(name, {}, "this processor has none of it")
    return Setting(name, {"NPY_DISABLE_CPU_FEATURES": " ".join(optional)})


def start_worker(variables: dict[str, str], words: list[str]) -> subprocess.CompletedProcess[str]:
    """Run bench.accuracy.machine_tables under a setting."""
    command = [sys.executable, "-m", "bench.accuracy.machine_tables", *words]
    environment = os.environ | AS_RENDERED | variables
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def read_here() -> dict[str, Any]:
    """The readings of this machine as it is. Raises CalledProcessError."""
    done = start_worker({}, [])
    if done.returncode:
        print(done.stderr, file=sys.stderr)
    done.check_returncode()
    return dict[str, Any](json.loads(done.stdout))


def explain_no_effect(setting: Setting, here: dict[str, Any], there: dict[str, Any]) -> str:
    """Why a setting did not come about; "" if it did. here, there: readings without the setting, and under it"""
    if asked := setting.variables.get("NPY_DISABLE_CPU_FEATURES"):
        kept = {*asked.split()} & {*there["numpy"]["used"]}
        return f"NumPy still uses {', '.join(sorted(kept))}" if kept else ""
    if core := setting.variables.get("OPENBLAS_CORETYPE"):
        took = there["blas"]  # it may call Prescott Katmai, whose code is the same
        is_taken = took.lower() == core.lower() or took != here["blas"]
        return "" if is_taken else f"OpenBLAS takes {took or 'no name'} instead, as it does by itself"
    if "GLIBC_TUNABLES" in setting.variables and there["libm"] == here["libm"]:
        return "its functions gave the same bits as before"
    return ""


def try_setting(setting: Setting, here: dict[str, Any]) -> tuple[dict[str, str], str]:
    """The digests under a setting; or none, and why. here: readings without it"""
    if setting.problem:
        return {}, setting.problem
    done = start_worker(setting.variables, [])
    if done.returncode < 0:
        return {}, f"this processor cannot run that code ({signal.Signals(-done.returncode).name})"
    if done.returncode:
        return {}, (done.stderr.strip().splitlines() or ["it failed"])[-1]
    there = json.loads(done.stdout)
    if problem := explain_no_effect(setting, here, there):
        return {}, problem
    return there["digests"], ""


def sample_differences(setting: Setting, names: list[str]) -> dict[str, float]:
    """The largest difference of the samples under a setting from those without it, as a share of the peak, by patch."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, variables in (("here", {}), ("there", setting.variables)):
            (Path(folder) / name).mkdir()
            done = start_worker(variables, [str(Path(folder) / name), *names])
            done.check_returncode()
        for name in names:
            here, there = (np.load(Path(folder) / place / f"{name}.npy") for place in ("here", "there"))
            found[name] = float(np.max(np.abs(here - there)) / max(np.max(np.abs(here)), 1e-300))
    return found


def describe(name: str, differences: dict[str, float]) -> str:
    """A patch, the difference of its samples where it is known, and a mark where it should not differ."""
    sound = f" {differences[name]:.0e}" if name in differences else ""
    return f"{name}{sound}" + ("" if name in DEPENDS_ON_MACHINE else " (!)")


def write_digests() -> None:
    """Write the digests of this machine to the file that is committed."""
    lines = [f"{name} {digest}\n" for name, digest in read_here()["digests"].items()]
    (ROOT / "patches" / SHIPPED_DIGESTS).write_text("".join(lines), "utf-8")


def main(words: list[str]) -> int:
    """Print the table, or write the digests; return 1 if a patch differs that is not known to, 2 for other words."""
    if not {*words} <= {"--samples", "--write"}:
        print("bench machines: machines [--samples] [--write]", file=sys.stderr)
        return 2
    if "--write" in words:
        write_digests()
        return 0
    committed, here = read_shipped_digests(), read_here()
    print(f"{processor_name()}; NumPy uses {', '.join(here['numpy']['used']) or 'its baseline'}; BLAS {here['blas']}")
    as_it_is = Setting("as it is", {})
    surprising = set()
    for setting in [as_it_is, *settings(here["numpy"])]:
        found, problem = (here["digests"], "") if setting is as_it_is else try_setting(setting, here)
        if problem:
            print(f"{setting.name:<26} left out: {problem}", flush=True)
            continue
        different = [name for name, digest in committed.items() if found.get(name) != digest]
        surprising |= {*different} - {*DEPENDS_ON_MACHINE}
        with_sound = "--samples" in words and different and setting is not as_it_is
        differences = sample_differences(setting, different) if with_sound else {}
        print(f"{setting.name:<26} {len(committed) - len(different)} of {len(committed)} the same", flush=True)
        listed = ", ".join(describe(name, differences) for name in different)
        for line in textwrap.wrap(listed, LINE_LENGTH - 4):
            print(f"    {line}", flush=True)
    return 1 if surprising else 0
