"""One misspelt word gives one error, though the key that it was meant for is missing and other tables depend on it."""

import random
import re
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT

import engine
from engine.patch.scene import scene_of_document

PATCHES = ROOT / "patches"
WORD = re.compile(r"[A-Za-z_]\w{2,}")


def faults_of(text: str) -> list[str]:
    """What is said of a patch."""
    try:
        scene_of_document(tomllib.loads(text), PATCHES, "p.toml", text)
    except engine.PatchError as error:
        return [str(fault) for fault in error.faults]
    return []


@pytest.mark.parametrize(
    ("patch", "old", "new", "says"),
    [
        ("bouncing_ball", 'name = "ball"', 'nmae = "ball"', 'body[0].nmae: unknown key; did you mean "name"?'),
        ("bouncing_ball", 'kind = "mass"', 'knid = "mass"', 'body[0].knid: unknown key; did you mean "kind"?'),
        ("bouncing_ball", "[[body]]", "[[bdoy]]", 'bdoy: unknown key; did you mean "body"?'),
        ("bouncing_ball", "barrier =", "barier =", 'contact[0].barier: unknown key; did you mean "barrier"?'),
        ("bouncing_ball", 'name = "ball"', 'name = "bal"', 'no body is named "ball", which several tables name; the'),
        ("bolt_on_a_string", 'kind = "mass"', 'kind = "mas"', 'body[1].kind: unknown kind "mas"; did you mean "mass"?'),
        ("slack_bass", "young = 2e11", "young_modulus = 2e11", 'young_modulus: unknown key; did you mean "young"?'),
        ("grand_c4", "frequency = 261", "frequenci = 261", 'frequenci: unknown key; did you mean "frequency"?'),
        ("grand_c2", "on_at =", "onat =", 'connection[0].onat: unknown key; did you mean "on_at"?'),
        ("guitar_body", 'on = "air"', 'on = "ai"', '.on: no body is named "ai"; the bodies are'),
        ("guitar", 'quantity = "pressure"', 'quantity = "presure"', '"presure" is not known; expected'),
        ("marimba_keys", "{ time = 0.0,", "{ tiem = 0.0,", 'note[0].tiem: unknown key; did you mean "time"?'),
        ("marimba_keys", "{ time = 0.0,", "{ time = -1.0,", "note[0].time: -1.0 is out of range"),
        ("bowed_vibraphone", 'name = "bow_c4"', 'naem = "bow_c4"', 'bow[1].naem: unknown key; did you mean "name"?'),
        ("marimba_keys", "[[key.body]]", "[[kye.body]]", 'kye: unknown key; did you mean "key"?'),
        ("guitar", "open =", "openx =", "keyboard.values.length: at key E2: unknown name open; the names are"),
        (
            "guitar",
            "= pick(string, 64",
            "= pik(string, 64",
            "keyboard.values.open: unknown function pik; the functions",
        ),
    ],
)
def test_one_slip_gives_one_error(patch, old, new, says):
    text = (PATCHES / f"{patch}.toml").read_text("utf-8")
    assert old in text
    (fault,) = faults_of(text.replace(old, new, 1))
    assert says in fault


def test_two_slips_give_two_errors_and_a_fault_that_a_slip_hides_is_found():
    text = (PATCHES / "bouncing_ball.toml").read_text("utf-8")
    wrong = text.replace("mass =", "mas =").replace("barrier =", "barier =").replace("exponent = ", "exponent = -")
    faults = faults_of(wrong)
    assert [fault.partition(": ")[0].partition(" ")[2] for fault in faults] == [
        "body[0].mas",
        "contact[0].barier",
        "contact[0].exponent",
    ]
    faults = faults_of(text.replace("mass = ", "mas = -"))
    assert len(faults) == 2
    assert any("body[0].mass: -" in fault and "is out of range" in fault for fault in faults)
    assert any("body[0].mas: unknown key" in fault for fault in faults)


def misspelt(word: str, draw: random.Random) -> str:
    """The word with a letter left out, doubled, or exchanged with the next."""
    at = draw.randrange(len(word) - 1)
    before, here, following, after = word[:at], word[at], word[at + 1], word[at + 2 :]
    middle = draw.choice([following, here + here + following, following + here])
    return before + middle + after


@pytest.mark.hard
@pytest.mark.parametrize("path", sorted(PATCHES.glob("*.toml")), ids=lambda path: path.stem)
def test_slips_anywhere_in_shipped_patches_give_one_error(path: Path):
    draw, text = random.Random(path.stem), path.read_text("utf-8")
    ends = [line.partition("#")[0] for line in text.splitlines()]
    words = [(n, word) for n, line in enumerate(ends) for word in WORD.finditer(line)]
    several = []
    for n, word in draw.sample(words, min(12, len(words))):
        lines = text.splitlines()
        lines[n] = lines[n][: word.start()] + misspelt(word[0], draw) + lines[n][word.end() :]
        try:
            tomllib.loads("\n".join(lines))
        except tomllib.TOMLDecodeError:
            continue
        faults = faults_of("\n".join(lines))
        several += [faults] if len(faults) > 1 else []
    assert len(several) <= 1, several
