"""The instruments in patches/: every key can be written out, and each has a piece that it can play."""

import tomllib

import pytest
from conftest import PATCHES

import engine
from bench.publish.gallery import TAIL, read_words
from bench.publish.pieces import PIECES
from engine.instrument.expansion import expand_for_score, keys_of
from engine.instrument.listing import list_key
from engine.patch.note_scene import scene_of_note

DOCUMENTS = {path.stem: tomllib.loads(path.read_text("utf-8")) for path in PATCHES}
INSTRUMENTS = sorted(name for name, document in DOCUMENTS.items() if "keyboard" in document)
WORDS = read_words()[1]


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_every_key_of_an_instrument_is_complete(name):
    scene = engine.load(name)
    keys = keys_of(DOCUMENTS[name]["keyboard"])
    for key in keys:
        assert list_key(DOCUMENTS[name], key, 100)["on"], key
    for key in {keys[0], keys[len(keys) // 2], keys[-1]}:
        assert scene_of_note(scene, key).event


@pytest.mark.hard_for("piano")
@pytest.mark.parametrize("name", [name for name in INSTRUMENTS if "piece" in WORDS[name]])
def test_each_instrument_has_keys_for_its_piece(name):
    score = PIECES[WORDS[name]["piece"]].score
    assert {note.key for note in score.notes} <= set(keys_of(DOCUMENTS[name]["keyboard"]))
    assert 30.0 <= score.end + TAIL <= 60.0
    scene = engine.load(name)
    assert scene.with_expansion(expand_for_score(DOCUMENTS[name] | {"seconds": None}, score)).event


def test_a_piece_is_played_by_most_instruments():
    assert (
        len([name for name in INSTRUMENTS if "piece" in WORDS[name]]) >= len(INSTRUMENTS) - 1
    )  # guitar_slide is a study
