"""A patch as a page: one HTML file in which it sounds, in any browser, without a network.

The kernels are those of live sound, as WebAssembly; the scene is the memory of a player that has not begun. The page's
script moves bytes and draws: it writes events to the player's queue, and lets the kernel play.
"""

import base64
import gzip
import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from engine.compiler.kernel_name import KernelName
from engine.compiler.wasm_multiply_add import make_replaceable
from engine.export.exchange_bytes import add_queued_exchanges
from engine.export.faults import CannotExport
from engine.export.key_tables import add_key_tables
from engine.export.motion import motion_data
from engine.export.player_bytes import (
    INSERT,
    INSERT_EVENT,
    MEMORY,
    RENDER,
    RENDER_BLOCK,
    arrays_of_player,
    lay_out_player,
    leave_out_products,
    leave_out_symmetry,
    requests_of,
)
from engine.export.row_recorder import (
    LEVELS,
    PEDAL_DOWN,
    SHARES,
    RowRecorder,
    check_output,
    keys_of_player,
    pads_of_player,
    player_of_keys,
    player_of_scene,
    player_of_voices,
    rows_of_score,
    sliders_of_player,
)
from engine.export.scene_bytes import SceneBytes
from engine.export.slider_values import find_value_places
from engine.export.table_sliders import BEND, CENTS, add_table_sliders, paths_of_sliders
from engine.export.voice_keys import bodies_of_notes, controls_of_voices, lowest_ratio
from engine.export.wasm_kernels import compile_module, general_module_of, read_module
from engine.instrument.score import Score, read_score
from engine.kernel.data.enums import Balance, EventKind, Sleep
from engine.live.midi_notes import PEDALS
from engine.live.shared_memory import Gauge, Slot
from engine.patch.scene import Scene
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot

BASE = 1 << 20  # address of the scene in the memory of the page; the stack and the kernels' constants lie below
BLOCK = 64  # samples that are computed at a time, half of what a browser asks for: a short touch is seen
MEGABYTE = 1 << 20
MAX_MEGABYTES = 400  # of a scene: browsers give pages some thousand
MOST_EXCHANGES = RowRecorder.queue_size - 128  # of tables, by a score: they wait beside what is played
PEDAL_NUMBERS: dict[str, Any] = {"pedals": PEDALS, "shares": SHARES, "pedal_down": PEDAL_DOWN}
PAGE = "page"  # the folder of the template
SCRIPTS = ("page.js", "keys.js", "voices.js", "controls.js", "motion.js", "embed.js", "start.js")  # the last begins


class PageSettings(NamedTuple):
    """Settings of a page."""

    samplerate: int = 44_100  # Hz
    kernel: str = KernelName.GENERAL  # or special: compiled for this scene, which takes a minute
    slide: Sequence[str] = ()  # live parameters that get a slider though each of its positions needs tables of its own
    voices: int = 0  # of a patch that is no instrument: notes of a keyboard at a time; 0: it has no keyboard


def make_page(
    scene: Scene,
    find_gain: Callable[[], float],
    settings: PageSettings,
    about: Mapping[str, str] | None = None,
) -> str:
    """Return a scene as a page.

    find_gain: returns the factor on SI units, once it is known that the scene can become a page
    about:     what the page says of itself: its `title`, the `text` of the patch and the `command` that made it

    Raises CannotExport (a ValueError) with the reason if the scene cannot become a page, BuildError (a ValueError) if
    it cannot be built.
    """
    samplerate, kernel, slide, voices = settings
    check_output(scene, "a page")
    if voices and slide:
        raise CannotExport("a page with voices has no sliders of its own choice: its voices share their tables")
    if voices:
        player = player_of_voices(scene, samplerate, kernel, voices, lowest_ratio(bodies_of_notes(scene)))
    else:
        find_player = player_of_scene if scene.instrument is None else player_of_keys
        player = find_player(scene, samplerate, kernel)
    if (count := len(player.tables.exchanges)) > MOST_EXCHANGES:
        message = f"the score changes parameters of bodies in {count} steps; a page has room for {MOST_EXCHANGES}"
        raise CannotExport(f"{message}: give fewer changes, or shorter durations")
    paths = paths_of_sliders(player, slide)
    laid_out = lay_out_player(player.memory, pointer_bytes=4, base=BASE)
    add_queued_exchanges(laid_out, player.memory.shared, player.tables.exchanges)
    sliders = sliders_of_player(player, paths)
    places = find_value_places(laid_out, player, sliders)
    controls = _controls(scene, player) | {"sliders": [slider._asdict() for slider in sliders], "value_places": places}
    controls |= controls_of_voices(laid_out, player) if voices else {"voices": []}
    controls |= add_key_tables(laid_out, player, {name: controls.get(name, []) for name in ("keys", "song")})
    tabled = {name: path for name, path in paths.items() if path is None or not path.is_glided}
    table_sliders = [slider._asdict() for slider in add_table_sliders(laid_out, player, tabled)]
    if len(laid_out.content) > MAX_MEGABYTES * MEGABYTE:
        size = len(laid_out.content) // MEGABYTE
        raise CannotExport(f"the patch needs {size} MB of memory; a page has {MAX_MEGABYTES} MB at most")
    model = player.memory.model_handles[0].value
    left_out = {"left_out": leave_out_products(laid_out, model), "symmetric": leave_out_symmetry(laid_out, model)}
    is_special = kernel == KernelName.SPECIAL
    module = compile_module(requests_of(player.memory.kinds)) if is_special else read_module(general_module_of(player))
    data = {
        "kernel": _packed(make_replaceable(module)),
        "scene": _packed(by_place(laid_out.content)),
        "size": len(laid_out.content),
        "base": BASE,
        "block": BLOCK,
        "samplerate": samplerate,
        "channels": player.channels,
        "gain": find_gain(),
        "score_seconds": scene.seconds,
        "coarsest": len(player.memory.models) + len(player.state.sleep) - 2,
        "at": places_of_player(laid_out, player),
        "names": names_of_numbers(),
        "functions": {RENDER: RENDER_BLOCK, INSERT: INSERT_EVENT},
    }
    controls |= left_out | {"table_sliders": table_sliders, "bend": BEND, "motion": motion_data(player.layout)}
    return compose({**data, "controls": _packed(_json(controls).encode())}, about or {})


def places_of_player(laid_out: SceneBytes, player: RowRecorder) -> dict[str, int]:
    """Return the addresses of what the page's script reads and writes."""
    state = player.state
    arrays = arrays_of_player(player.memory)
    arrays |= {"sleep": state.sleep, "iterations": state.iteration_histogram, "force": state.contact_force}
    arrays |= {"omega_squared": player.model.omega_squared, "q": state.q, "p": state.p, "flight": state.flight.frame}
    counts = {"queue": len(arrays["events"]), "islands": len(state.sleep), "contacts": state.contact_force.size}
    counts |= {"solves": state.iteration_histogram.shape[-1], "event": len(EventSlot), "rest": state.sleep.shape[1]}
    counts |= {"table": EventSlot.TABLE, "note": EventSlot.NOTE, "release": EventSlot.IS_RELEASE}
    counts |= {"values_per_event": VALUES_PER_EVENT, "modes": state.q.size}
    return {MEMORY: laid_out.address(MEMORY)} | {n: laid_out.address(a) for n, a in arrays.items()} | counts


def names_of_numbers() -> dict[str, dict[str, int]]:
    """Return the numbers of the engine that the page's script uses, by name."""
    return {
        "Slot": {slot.name: int(slot) for slot in Slot},
        "Gauge": {gauge.name: int(gauge) for gauge in Gauge},
        "Balance": {one.name: int(one) for one in Balance},
        "Sleep": {one.name: int(one) for one in Sleep},
        "EventKind": {kind.name: int(kind) for kind in (EventKind.QUALITY, EventKind.EXCHANGE_TABLES)},
    }


def _controls(scene: Scene, player: RowRecorder) -> dict[str, Any]:
    """Return the controls of a scene but for its sliders: keys or pads, and its score."""
    if scene.instrument is None:
        pads = [] if player.voices else [pad._asdict() for pad in pads_of_player(player)]
        return {
            "keys": [],
            "pads": pads,
            "damp": damp_rows(player),
            **PEDAL_NUMBERS,
        }
    keys = [key._asdict() for key in keys_of_player(player)]
    keyboard = scene.instrument["keyboard"]
    polyphony = keyboard.get("polyphony") or len(keys)
    score = score_of(scene, [key["number"] for key in keys])
    song = rows_of_score(player, score)
    return {
        "keys": keys,
        "levels": LEVELS,
        "polyphony": polyphony,
        "bend_cents": CENTS * scene.midi.bend_range,
        **PEDAL_NUMBERS,
        "song": song,
        "song_notes": [[note.key, note.time, note.end] for note in score.notes],
        "pads": [],
        "damp": [],
    }


def damp_rows(player: RowRecorder) -> list[list[float]]:
    """Return the rows that damp all bodies for a while."""
    player.damp()
    return player.take_rows()


def score_of(scene: Scene, keys: list[int]) -> Score:
    """Return the score of an instrument: its own, or a note of its middle."""
    score = read_score(scene.instrument or {})
    return score if score.notes else score.with_middle_note(keys)


# --- the file


def compose(data: Mapping[str, Any], about: Mapping[str, str]) -> str:
    """Return the HTML of a page of this data. It loads nothing from anywhere, and runs no scripts but its own."""
    content, style = _escaped_json(data), template("page.css")
    script = "\n".join(template(name) for name in SCRIPTS)
    policy = (
        f"default-src 'none'; script-src 'sha256-{_digest(script)}' 'wasm-unsafe-eval' data:;"
        f" style-src 'sha256-{_digest(style)}'; img-src data:; media-src blob:"
    )
    filled = {
        "TITLE": escape(about.get("title", "A patch"), quote=True),
        "POLICY": escape(policy, quote=True),
        "TEXT": escape(about.get("text", "")),
        "COMMAND": escape(about.get("command", "")),
        "STYLE": style,
        "SCRIPT": script,
        "WORKLET": _escaped_json({"source": template("worklet.js")}),
        "DATA": content,
    }
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda place: filled[place[1]], template("page.html"))


def template(name: str) -> str:
    """Return a file that pages are made of, scripts without the lines that are remarks, and without indentation."""
    text = files("engine.export").joinpath(PAGE, name).read_text("utf-8")
    return re.sub(r"(?m)^\s*(//.*\n)?", "", text) if name.endswith(".js") else text


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def by_place(content: bytearray) -> bytes:
    """Return numbers of eight bytes with all their first bytes first, then all their second ones, …: neighbours are
    alike then, which packs better."""
    whole = bytes(content) + bytes(-len(content) % 8)
    return np.frombuffer(whole, np.uint8).reshape(-1, 8).T.tobytes()


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def _json(data: Mapping[str, Any]) -> str:
    return json.dumps(_shortened(data), separators=(",", ":"), allow_nan=False)


def _shortened(node: Any) -> Any:
    """Return data in which whole numbers are integers, without a point and a zero."""
    if isinstance(node, Mapping):
        return {name: _shortened(inner) for name, inner in node.items()}
    if isinstance(node, list | tuple):
        return [_shortened(inner) for inner in node]
    is_whole = isinstance(node, float) and node.is_integer() and str(node) != "-0.0"
    return int(node) if is_whole else node


def _escaped_json(data: Mapping[str, Any]) -> str:
    """Return data as JSON that may stand in a script element."""
    return _json(data).replace("<", "\\u003c")
