"""Notes on a patch that works."""

import warnings

import engine
from engine.cli.messages import patch_warnings_as_notes


def test_a_warning_of_a_patch_is_one_note_and_others_stay_what_they_are(capsys, recwarn):
    with patch_warnings_as_notes():
        for _ in range(2):
            warnings.warn("mine.toml:3 seconds: has no effect", engine.PatchWarning, stacklevel=1)
    assert capsys.readouterr().err == "note: mine.toml:3 seconds: has no effect\n"
    with patch_warnings_as_notes():
        warnings.warn("of a library", UserWarning, stacklevel=1)
    assert "note: " not in capsys.readouterr().err
