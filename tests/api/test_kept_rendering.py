"""A rendering whose file is open in a player, which Windows does not let one replace: what was computed is kept."""

import os

import numpy as np
import pytest
import soundfile
from conftest import exit_code

from engine import output_files

AUDIO = np.linspace(-0.5, 0.5, 100)[:, None]


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """A file that another program has open, as Windows answers when it is to be replaced."""
    path, replace = tmp_path / "Tanpura.wav", os.replace
    path.write_bytes(b"what is played")

    def refuse(source, target):
        if os.fspath(target) == os.fspath(path):
            raise PermissionError(13, "Access is denied", source)
        replace(source, target)

    monkeypatch.setattr(os, "replace", refuse)
    return path


def test_the_sound_is_kept_under_another_name_which_is_said(opened):
    with pytest.raises(PermissionError) as refused:
        output_files.save_audio(opened, AUDIO, 44_100, None)
    reason = output_files.error_reason(refused.value)
    assert reason == "access is denied; what was written is in Tanpura_2.wav"
    assert opened.read_bytes() == b"what is played"
    assert np.allclose(soundfile.read(opened.with_name("Tanpura_2.wav"))[0], AUDIO[:, 0])
    assert {path.name for path in opened.parent.iterdir()} == {"Tanpura.wav", "Tanpura_2.wav"}


def test_the_command_says_where_it_is(opened, capsys):
    assert exit_code("bouncing_ball", "--seconds", "0.1", "-o", str(opened)) == 1
    assert "(access is denied; what was written is in Tanpura_2.wav)" in capsys.readouterr().err
    assert soundfile.info(opened.with_name("Tanpura_2.wav")).frames == 4410


def test_where_it_cannot_be_renamed_either_the_temporary_file_stays(opened, monkeypatch):
    def refuse(source, target):
        raise PermissionError(13, "Access is denied", source)

    monkeypatch.setattr(os, "rename", refuse)
    with pytest.raises(PermissionError, match=r"what was written is in \.Tanpura\.wav\.\d+\.part"):
        output_files.write_text(opened, "text")
    (part,) = opened.parent.glob(".*.part")
    assert part.read_text() == "text"


def test_what_fails_while_it_is_written_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), output_files.atomic_write(tmp_path / "a.txt") as path:
        path.write_text("half")
        _ = 1 / 0
    assert list(tmp_path.iterdir()) == []
