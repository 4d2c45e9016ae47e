"""A script that renders with several processes, and whose last lines have no main guard."""

import subprocess
import sys

import pytest

SCRIPT = """import fdh
print("started")
scene = fdh.load("bouncing_ball").replace("seconds", 0.05)
fdh.run_sweep_rows(scene, {"body.ball.displacement": [0.1, 0.2]}, "balls", cores=2)
"""


@pytest.mark.hard
def test_a_script_without_a_main_guard_is_told_so_in_one_line(tmp_path):
    """The worker, which imports the script, says nothing of its own and touches no file of the sweep."""
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    lines = done.stderr.splitlines()
    assert lines[-1].startswith("RuntimeError: a script that renders with several processes is imported by each of")
    assert lines[-1].endswith('put what starts it under if __name__ == "__main__":')
    assert sum(line.startswith("Traceback") for line in lines) == 1 and "killed" not in done.stderr
    assert done.returncode == 1
