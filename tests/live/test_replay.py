"""Sessions on devices of one, two and six channels: the log of each makes the same samples again."""

import argparse
import json
import math
import re
import tomllib
from typing import Any

import numpy as np
import pytest
from conftest import PATCHES, ROOT, mostly_hard

import engine
from engine.cli.live_session import PlayerFactory
from engine.live.player import Player
from engine.live.replay import replay
from engine.patch.scene import Scene

TOML = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHIPPED = [str(path.relative_to(ROOT)) for path in [*PATCHES, *sorted((ROOT / "patches/templates").glob("*.toml"))]]
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


def load(name: str) -> Scene:
    """A patch of the repository, or of a guide."""
    if name in DOCUMENTED:
        return engine.load(tomllib.loads(DOCUMENTED[name]))
    return engine.load(ROOT / name)


def on_device(scene: Scene, channels: int) -> Scene:
    """The scene as `fdh play` brings it to a device of so many channels."""
    return PlayerFactory(argparse.Namespace(midi=None, osc=None, accuracy={}), 44_100, channels).prepare(scene)


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


@pytest.mark.parametrize("channels", [1, 2, 6])
@pytest.mark.parametrize(
    "name", mostly_hard([*SHIPPED, *DOCUMENTED], "live.md 1", "patches/piano_c4.toml", "patches/rattle.toml")
)
def test_a_session_is_replayed(name, channels):
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
