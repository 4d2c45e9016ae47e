"""Sessions on devices of one, two and six channels: the log of each makes the same samples again."""

import argparse
import itertools
import json
import math
import re
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import soundfile
from conftest import PATCHES, ROOT

import engine
from engine.cli import main
from engine.cli.live_session import PlayerFactory
from engine.live.player import Player
from engine.live.replay import replay
from engine.patch.scene import Scene

TOML = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHIPPED = [str(path.relative_to(ROOT)) for path in [*PATCHES, *sorted((ROOT / "patches/templates").glob("*.toml"))]]
KEPT = ["live.md 1", "patches/piano_c4.toml", "patches/rattle.toml"]
CHANNELS = [1, 2, 6]
BLOCK, BLOCKS = 64, 6


def documented_patches() -> dict[str, str]:
    """The patches of the guides: a block that begins with a title, and those after it that add to it."""
    patches: dict[str, str] = {}
    for page in sorted((ROOT / "docs").glob("*.md")):
        for block in TOML.findall(page.read_text("utf-8")):
            names = [name for name in patches if name.startswith(f"{page.name} ")]
            if block.startswith("title = "):
                patches[f"{page.name} {len(names) + 1}"] = block
            elif names and (block.startswith("[[") or not block.startswith("[")):
                patches[names[-1]] += block
    return patches


DOCUMENTED = documented_patches()


def others() -> Iterator[Any]:
    """All other patches, in turn on one of the devices; that others map their channels alike is a slow check."""
    for n, name in enumerate([*SHIPPED, *DOCUMENTED]):
        for channels in CHANNELS if name not in KEPT else []:
            in_turn = channels == CHANNELS[n % len(CHANNELS)]
            yield pytest.param(name, channels, marks=pytest.mark.hard if in_turn else pytest.mark.slow)


def load(name: str) -> Scene:
    """A patch of the repository, or of a guide."""
    if name in DOCUMENTED:
        return engine.load(tomllib.loads(DOCUMENTED[name]))
    return engine.load(ROOT / name)


def on_device(scene: Scene, channels: int) -> Scene:
    """The scene as `fdh play` brings it to a device of so many channels."""
    return PlayerFactory(
        argparse.Namespace(midi=None, osc=None, accuracy={}, tuning=None, keyboard_map=None), 44_100, channels
    ).prepare(scene)


def play(player: Player, blocks: int) -> np.ndarray:
    out = np.zeros((blocks * BLOCK, player.channels), np.float32)
    for begin in range(0, len(out), BLOCK):
        player.render_into(out[begin : begin + BLOCK])
    return out


def play_session(player: Player) -> np.ndarray:
    """Some blocks, with a strike, and a change of the first parameter of each section and of each pickup."""
    heard = [play(player, 1)]
    if player.strikers:
        player.strike()
    turned = {path.split(".")[0]: path for path in player.live_parameters if not path.startswith("pickup")}
    gains = [path for path in player.live_parameters if path.startswith("pickup") and path.endswith("gain")]
    for path in [*turned.values(), *gains]:
        player.set(path, player.value(path) * 0.99, seconds=0.002)
        heard.append(play(player, 1))
    return np.concatenate([*heard, play(player, BLOCKS)])


def check_replay(name: str, channels: int) -> None:
    """What a session of a patch on a device sounds like is what its log makes of it."""
    scene = load(name)
    player = Player(on_device(scene, channels), seconds=math.inf, gain=1e-3)
    assert player.channels == max(scene.channels, min(2, channels))
    played = play_session(player)
    log: dict[str, Any] = json.loads(json.dumps(player.log()))
    np.testing.assert_array_equal(replay(log), played)
    if scene.channels == 1:
        np.testing.assert_array_equal(played, played[:, :1].repeat(player.channels, axis=1))


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("name", KEPT)
def test_a_session_is_replayed(name, channels):
    check_replay(name, channels)


@pytest.mark.hard
def test_a_glide_of_which_one_parameter_is_left_is_replayed():
    """While bars are bent together, all but one are bent anew; some of these sound, some fall asleep meanwhile."""
    player = Player(engine.load("marimba_keys"), seconds=math.inf, gain=1e-3)
    bars = {path: player.value(path) for path in player.live_parameters if path.endswith("5_bar.frequency")}
    left = "body.E5_bar.frequency"
    for striker in player.strikers:
        player.strike(striker)
    heard = [play(player, 400)]
    for turn in range(8):
        player.set({path: value * (1.01 + 0.001 * turn) for path, value in bars.items()}, seconds=0.04)
        heard.append(play(player, 14))
        player.set({path: value for path, value in bars.items() if path != left}, seconds=0.02)
        heard.append(play(player, 200))
    log = player.log()
    exchanged = [entry["why"] for entry in log["events"] if entry["why"][0] == "set"]
    assert any(why[1] == left for why in exchanged)
    np.testing.assert_array_equal(replay(log), np.concatenate(heard))


@pytest.mark.parametrize(("name", "channels"), list(others()))
def test_a_session_of_any_patch_is_replayed(name, channels):
    check_replay(name, channels)


def test_a_pickup_on_two_channels():
    """One pickup on a list of channels is the same as one on each; its gain turns both."""
    scene = load("live.md 1")
    pickup = scene.pickup[0].model_dump(exclude_unset=True)
    document = scene.model_dump(exclude_unset=True) | {"control": []}
    both = Scene.model_validate(document | {"pickup": [pickup | {"channel": [1, 3]}]})
    apart = Scene.model_validate(document | {"pickup": [pickup, pickup | {"name": "other", "channel": 3}]})
    audio = engine.render(both, seconds=0.02).audio
    assert audio.shape[1] == 3 and audio[:, 0].any() and not audio[:, 1].any()
    np.testing.assert_array_equal(audio, engine.render(apart, seconds=0.02).audio)
    player = Player(both, seconds=math.inf, gain=1e-3)
    player.set("pickup.ear.gain", 0.0, seconds=0.0)
    play(player, 1)
    assert not play(player, BLOCKS).any()


@pytest.mark.parametrize("channel", [0, 17, 1.5, [], [1, 1], [0], "left", True])
def test_a_pickup_on_no_channel(channel):
    document = load("live.md 1").model_dump(exclude_unset=True)
    with pytest.raises(
        engine.PatchError, match=r"pickup\[0\].channel: .* is no channel; give a whole number from 1 to 16"
    ):
        engine.load(document | {"pickup": [document["pickup"][0] | {"channel": channel}]})


def warnings_of(log: dict[str, Any]) -> list[str]:
    """What a replay of a log says of it, in which the sound is the same."""
    said: list[str] = []
    assert np.array_equal(replay(log, warn=said.append), replay(log))
    return said


@pytest.mark.hard
def test_a_replay_says_that_its_tables_differ_from_those_of_the_log(patch):
    """In a line, also where several players took over; an older log names no tables."""
    players = [Player(patch(name), seconds=math.inf, gain=0.1) for name in ("piano_c4", "tanpura", "piano_c4")]
    for player, following in itertools.pairwise(players):
        play(players[0], 2)
        player.cross_fade_to(following)
    play(players[0], 40)
    log = json.loads(json.dumps(players[0].log()))
    digests = [player.table_digest for player in players]
    assert [log["table_digest"], log["next"]["table_digest"]] == digests[:2] and digests[0] == digests[2]
    assert warnings_of(log) == []
    log["next"] |= {"table_digest": "0123456789abcdef"}
    (message,) = warnings_of(log)
    assert message.startswith(f"tables {digests[1]} differ from those of the session, 0123456789abcdef")
    log["table_digest"] = "00"
    assert len(warnings_of(log)) == 1
    del log["table_digest"], log["next"]["table_digest"]
    assert warnings_of(log) == []
    with pytest.raises(ValueError, match="table_digest"):
        replay(log | {"table_digest": "no digest"})


def test_a_command_that_replays_other_tables_says_so_and_goes_on(tmp_path, patch, capsys):
    player = Player(patch("piano_c4"), seconds=math.inf, gain=0.1)
    heard = play(player, 20)
    path, out = tmp_path / "log.json", tmp_path / "again.wav"
    path.write_text(json.dumps(player.log() | {"table_digest": "0123456789abcdef"}), "utf-8")
    assert main.main(["replay", str(path), "-o", str(out)]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{path}: tables {player.table_digest} differ from those of the session, 0123456789abcdef")
    np.testing.assert_array_equal(soundfile.read(out, dtype="float32", always_2d=True)[0], heard)
