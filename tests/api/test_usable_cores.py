"""How many cores a render takes by itself: those that this process may use, not all that the machine has."""

import os
import subprocess
import sys

import pytest
from conftest import ROOT

from engine import provenance


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no affinity")
def test_cores_are_those_that_the_process_may_run_on():
    one = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, {{{one}}}); from engine import provenance as p; print(p.usable_cores())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"


@pytest.mark.parametrize(("quota", "count"), [(0.5, 1), (2.9, 2), (64.0, 8), (float("inf"), 8)])
def test_the_quota_of_a_container_limits_them(monkeypatch, quota, count):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)), raising=False)
    monkeypatch.setattr(provenance, "_processor_quota", lambda: quota)
    assert provenance.usable_cores() == count


GROUPS = {  # what a system has in its files, and the processors that they allow
    "version 2": ("0::/box/inner\n", {"box/inner/cpu.max": "250000 100000", "box/cpu.max": "400000 100000"}, 2.5),
    "version 2, the limit is that of a group above": (
        "0::/box/inner\n",
        {"box/inner/cpu.max": "max 100000", "box/cpu.max": "150000 100000"},
        1.5,
    ),
    "version 2, in a container, which is the top of what it sees": ("0::/\n", {"cpu.max": "100000 100000"}, 1.0),
    "version 2, in a container that knows its outer name": ("0::/outer/name\n", {"cpu.max": "100000 100000"}, 1.0),
    "version 1": (
        "9:memory:/box\n4:cpu,cpuacct:/box\n",
        {"cpu,cpuacct/box/cpu.cfs_quota_us": "300000", "cpu,cpuacct/box/cpu.cfs_period_us": "100000"},
        3.0,
    ),
    "version 1, without a limit": (
        "4:cpu:/\n",
        {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"},
        float("inf"),
    ),
    "no limit": ("0::/\n", {}, float("inf")),
    "no groups": (None, {}, float("inf")),
}


@pytest.mark.parametrize("case", GROUPS)
def test_the_quota_is_read_from_control_groups(tmp_path, case):
    groups, written, processors = GROUPS[case]
    if groups is not None:
        (tmp_path / "cgroup").write_text(groups)
    for name, text in written.items():
        (tmp_path / "mounted" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "mounted" / name).write_text(text + "\n")
    assert provenance._processor_quota(tmp_path / "cgroup", tmp_path / "mounted") == processors
