"""The package imported from a zip, as zipapp and pex have it: the shipped patches are found by their names."""

import subprocess
import sys
import zipfile

import pytest
from conftest import PATCHES, ROOT


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """A zip with what a wheel holds of Python and of patches."""
    path = tmp_path_factory.mktemp("zip") / "engine.zip"
    with zipfile.ZipFile(path, "w") as file:
        for name, folder in {"engine": "engine", "fdh": "fdh", "patches": "engine/patches"}.items():
            for source in (ROOT / name).rglob("*"):
                if source.suffix in (".py", ".toml", ".json", ".csv"):
                    file.write(source, f"{folder}/{source.relative_to(ROOT / name).as_posix()}")
    return path


def run(packed, folder, code):
    """What Python prints of a piece of code that imports from the zip, and not from here."""
    start = f"import sys; sys.path[:] = [{str(packed)!r}] + [p for p in sys.path if p not in ('', {str(ROOT)!r})]; "
    done = subprocess.run([sys.executable, "-c", start + code], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.hard
def test_shipped_patches_are_read_by_name(packed, tmp_path):
    code = "import fdh, engine.files as f; print(f.__file__, fdh.load('tanpura').title, *f.shipped_names(), sep='\\n')"
    where, title, *names = run(packed, tmp_path, code).splitlines()
    assert where.startswith(str(packed)) and "tanpura" in title.lower()
    assert names == [path.stem for path in PATCHES]


def test_what_was_unpacked_is_gone_at_the_end(packed, tmp_path):
    folder = run(packed, tmp_path, "import engine.files as f; print(f.SHIPPED_PATCHES, (f.SHIPPED_PATCHES).is_dir())")
    path, there = folder.split()
    assert there == "True" and not ROOT.joinpath(path).exists()


@pytest.mark.hard
def test_commands_find_patches_templates_and_the_schema(packed, tmp_path):
    code = "from engine.cli.main import main; sys.exit(main(['new', 'mine']) or main(['check', 'mine.toml']))"
    assert "mine.toml: valid; " in run(packed, tmp_path, code)
