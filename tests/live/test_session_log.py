"""The log of a session grows on disk while it is played: it holds what happened, memory does not grow, and its replay
is what was heard, bit for bit."""

import json
import math
import statistics
import time
from collections import Counter
from typing import Any

import numpy as np
import pytest

import engine
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.log_file import LogFile
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.live.replay import read_log, replay

KEYS = """
[keyboard]
keys = "C4..E4"

[[key.body]]
name = "string"
kind = "string"
length = 0.6
mass = 0.003
frequency = "= f"
sigma0 = 1.0
modes = 8

[[key.body]]
name = "hammer"
kind = "mass"
mass = 0.003
displacement = -0.05

[[key.contact]]
name = "felt"
body = "hammer"
on = "string"
on_at = 0.12
stiffness = 4e9
exponent = 2.5

[[key.pickup]]
body = "string"
at = 0.3
[[key.on]]
kind = "strike"
body = "hammer"
displacement = -1e-3
velocity = "= 4*v"

[[key.on]]
kind = "pluck"
body = "string"
at = 0.2
amplitude = "= 2*v"
duration = 1e-3

[[key.on]]
time = 0.05
kind = "change"
parameter = "body.string.sigma0"
value = 2.0

[[key.damper]]
body = "string"
sigma = 30.0
"""
NAMES = "C4", "D4", "E4"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A few keys, each with a hammer and a pluck, to be played live."""
    path = tmp_path_factory.mktemp("patch") / "keys.toml"
    path.write_text(KEYS, "utf-8")
    return live_scene(engine.load(path))


def make_player(scene: engine.Scene, cores: int = 1, **options: Any) -> Player:
    return Player(scene, gain=0.01, seconds=math.inf, waiting=True, cores=cores, **options)


class Musician:
    """Plays a player in blocks of many sizes, with all that can happen: the same for the same seed."""

    def __init__(self, first: Player, seed: int) -> None:
        self.first = first
        self.heard: list[np.ndarray] = []
        self._rng = np.random.default_rng(seed)
        self.use(first)

    def use(self, player: Player) -> None:
        """Go on with a player, the first or one that takes over."""
        self.player, self.keys = player, KeyAllocator(player)

    def play(self, blocks: int) -> None:
        for _ in range(blocks):
            for _ in range(int(self._rng.integers(0, 4))):
                self._act()
            out = np.zeros((int(self._rng.integers(64, 1001)), self.player.channels), np.float32)
            self.first.render_into(out)
            self.heard.append(out)

    def _act(self) -> None:
        rng, player = self._rng, self.player
        key, ahead = int(rng.integers(60, 65)), player.frame + 8820  # told 0.2 s before
        frame = ahead if rng.random() < 0.5 else 0
        name, value = NAMES[int(rng.integers(3))], float(rng.uniform(0.8, 1.2))
        match int(rng.integers(9)):
            case 0 | 1:
                self.keys.play(Note(0.0, "on", key, float(rng.integers(30, 127))), frame)
            case 2:
                self.keys.play(Note(0.0, "off", key, 64), frame)
            case 3:
                self.keys.play(Note(0.0, "sustain", 0, float(rng.integers(0, 128))), frame)
            case 4:
                player.set(f"contact.{name}_felt.stiffness", 4e9 * value, 0.01, frame)
            case 5:
                player.set(f"body.{name}_string.frequency", 262.0 * value, 0.02, frame)
            case 6:  # what was told for later is withdrawn, once something else counts at once
                player.set(f"body.{name}_string.frequency", 240.0 * value, 0.0, ahead)
                player.make_tables()
                player.set(f"body.{name}_string.frequency", 262.0 * value, 0.0)
            case 7:
                player.cancel(key + 1)
            case _:
                if rng.random() < 0.3:
                    for _ in range(100):  # of which an island has no room for all
                        player.strike(f"{name}_hammer", value, frame=ahead)


def of_json(record: dict[str, Any]) -> dict[str, Any]:
    """What a log is after it was a file."""
    return json.loads(json.dumps(record))


def sorted_out(log: dict[str, Any]) -> tuple[list[Any], Counter[str]]:
    """The events that were done, in their order, and those that were not."""
    done = [event for event in log["events"] if event["frame"] is not None]
    return done, Counter(json.dumps(event["why"]) for event in log["events"] if event["frame"] is None)


def same(written: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Check that two logs say the same, and so do those of the players that took over."""
    assert sorted_out(written) == sorted_out(wanted)
    assert set(written) == set(wanted)
    assert all(written[name] == wanted[name] for name in written if name not in ("events", "next"))
    if "next" in written:
        same(written["next"], wanted["next"])


@pytest.mark.hard
@pytest.mark.parametrize("cores", [1, 2])
@pytest.mark.parametrize("switches", [0, 2])
def test_a_log_that_is_written_in_steps_is_that_of_a_twin(scene, tmp_path, cores, switches):
    """Nothing is missing and nothing is there twice, whatever was withdrawn or dropped meanwhile; and the file and the
    log in memory make the samples that were heard."""
    first, twin = (Musician(make_player(scene, cores), seed=7) for _ in range(2))
    file = LogFile(tmp_path / "log.json", first.first)
    for part in range(switches + 1):
        for musician in (first, twin):
            if part:
                following = make_player(scene, cores)
                musician.player.cross_fade_to(following)
                musician.use(following)
        for _ in range(40 if switches == 0 else 25):
            first.play(1)
            twin.play(1)
            file.write()
    assert not (tmp_path / "log.json").exists() and file.temporary.stat().st_size > 20_000
    file.close()
    assert file.error is None and [path.name for path in tmp_path.iterdir()] == ["log.json"]
    written, wanted = json.loads((tmp_path / "log.json").read_text("utf-8")), of_json(twin.first.log())
    same(written, wanted)
    whys = json.dumps(written)
    assert all(word in whys for word in ('"strike"', '"pluck"', '"cancel"', '"sustain"', '"set"', "dropped: too many"))
    assert "withdrawn" not in whys and ": refused" not in whys
    heard = np.concatenate(first.heard)
    assert heard.any() and np.isfinite(heard).all()
    np.testing.assert_array_equal(np.concatenate(twin.heard), heard)
    np.testing.assert_array_equal(replay(read_log(tmp_path / "log.json")), heard)
    np.testing.assert_array_equal(replay(wanted), heard)


def test_what_may_still_be_dropped_is_not_written_yet(scene, tmp_path):
    """It is written once it was done, as what it is then."""
    player = make_player(scene)
    file = LogFile(tmp_path / "log.json", player)
    for _ in range(100):
        player.strike("C4_hammer", 1.0, frame=2000)
    player.render_into(np.zeros((64, player.channels), np.float32))
    file.write()
    assert '"why": ["strike"' not in file.temporary.read_text("utf-8")
    player.render_into(np.zeros((4000, player.channels), np.float32))
    file.write()
    said = file.temporary.read_text("utf-8")
    assert said.count('"why": ["strike"') == 100
    assert said.count("dropped: too many") == player.meter().dropped > 0
    file.close()


# --- memory and time


def kept(player: Player) -> int:
    """How many events are in memory."""
    queue = player._queue
    return len(queue._log) + len(queue._pending) + len(queue._waiting) + len(queue._groups)


@pytest.mark.hard
@pytest.mark.parametrize("keeps", [True, False])
def test_what_was_written_takes_no_memory(scene, tmp_path, keeps):
    player = make_player(scene, log=keeps)
    file = LogFile(tmp_path / "log.json", player) if keeps else None
    keys, out, most = KeyAllocator(player), np.zeros((256, player.channels), np.float32), 0
    for n in range(12_000):
        if n % 10 == 0:
            keys.play(Note(0.0, "sustain", 0, 127.0 * (n % 20 == 0)))
        else:
            player.lift(f"{NAMES[n % 3]}_string")
        if n % 20 == 19:
            player.render_into(out)
        if n % 400 == 399 and file is not None:
            file.write()
            most = max(most, kept(player))
    assert player._queue.pending() == 0
    assert kept(player) <= (most if keeps else 2) <= 40
    assert len(player._queue._begun_later) <= 2 * 4096
    if file is None:
        assert not player._queue._log and not player._queue._begun_later
        with pytest.raises(RuntimeError, match="the player keeps no log, as it was made with log = False"):
            player.log()
        return
    file.close()
    assert len(json.loads((tmp_path / "log.json").read_text("utf-8"))["events"]) > 11_000


@pytest.mark.system
def test_the_meter_is_read_as_fast_after_many_events(scene):
    """Processor time, the median of fifty readings after 200 000 events."""
    player = make_player(scene)
    out = np.zeros((64, player.channels), np.float32)
    for _ in range(200):
        for _ in range(1000):
            player.cancel(99)
        player.render_into(out)
    assert len(player.log()["events"]) == 200_000
    taken = []
    for _ in range(50):
        begin = time.process_time()
        player.meter()
        taken.append(time.process_time() - begin)
    assert statistics.median(taken) < 1e-3


@pytest.mark.slow
def test_a_log_of_more_than_64_mb_is_replayed(scene, tmp_path):
    """Hours of harmless events among some notes change nothing."""
    player = make_player(scene)
    musician = Musician(player, seed=3)
    musician.play(100)
    log = of_json(player.log())
    heard, idle = np.concatenate(musician.heard), {"frame": 0, "why": ["cancel", 99], "row": [0] * 11}
    player.cancel(99)
    player.render_into(np.zeros((64, player.channels), np.float32))
    idle["row"] = player.log()["events"][-1]["row"]
    count = 66_000_000 // len(json.dumps(idle))
    frames = np.sort(np.random.default_rng(1).integers(0, len(heard), count)).tolist()
    many = [idle | {"frame": frame} for frame in frames]
    log["events"] = sorted([*log["events"], *many], key=lambda event: event["frame"] or 0)
    path = tmp_path / "log.json"
    path.write_text(json.dumps(log), "utf-8")
    assert path.stat().st_size > 64_000_000
    np.testing.assert_array_equal(replay(read_log(path)), heard)


@pytest.mark.slow
def test_a_log_of_more_than_64_mb_is_written_while_it_is_played(scene, tmp_path):
    """Many harmless events among some notes: memory holds those of the last moments, as some were told 0.2 s before,
    and the replay is what was heard, bit for bit."""
    player = make_player(scene)
    musician, file, memory = Musician(player, seed=5), LogFile(tmp_path / "log.json", player), list[int]()
    while file.temporary.stat().st_size <= 64_000_000:
        for _ in range(2000):
            player.cancel(10**18)
        musician.play(1)
        file.write()
        memory.append(kept(player))
    file.close()
    half = len(memory) // 2
    assert file.error is None and max(memory[half:]) < 1.5 * max(memory[:half])  # it does not grow with the log
    path = tmp_path / "log.json"
    assert path.stat().st_size > 64_000_000
    heard = np.concatenate(musician.heard)
    assert heard.any()
    np.testing.assert_array_equal(replay(read_log(path)), heard)


@pytest.mark.hard
def test_a_pedal_of_the_piano_is_one_event(tmp_path):
    """Moved a hundred times over all its strings: the events take less than 200 kB, none is dropped, and the replay is
    the same."""
    player = make_player(live_scene(engine.load("piano")))
    file, keys = LogFile(tmp_path / "log.json", player), KeyAllocator(player)
    out = np.zeros((100, 300, player.channels), np.float32)
    for n, block in enumerate(out):
        if n % 10 == 5:
            keys.play(Note(0.0, "on", 40 + n % 30, 90))
        keys.play(Note(0.0, "sustain", 0, 127.0 * (n % 2 == 0)))
        player.render_into(block)
        file.write()
    file.close()
    log = json.loads((tmp_path / "log.json").read_text("utf-8"))
    pedals = [event for event in log["events"] if event["why"][0] == "sustain"]
    assert len(pedals) == 100 and all(event["sets"] for event in pedals)
    assert len(json.dumps(log["events"])) < 200_000 and player.meter().dropped == 0
    assert out.any()
    np.testing.assert_array_equal(replay(log), out.reshape(-1, player.channels))
