"""A patch as a library in C: a header, object files with the kernels and with the memory of a player, and an example.

The kernels are those of live sound: the general ones come with the engine, special ones are compiled for the patch. An
instrument has two players: one of its score, so that the samples are those of a rendering, and one of its keys.
"""

import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path

import numpy as np

from engine.assembly.build import build
from engine.compiler.kernel_name import KernelName
from engine.compiler.targets import OF_LIBRARIES, TARGETS, target_named
from engine.export.c_events import EventTables
from engine.export.c_kernels import LinkedKernels
from engine.export.faults import CannotExport
from engine.export.player_bytes import INSERT, MEMORY, PLAY, RENDER, arrays_of_player, lay_out_player, requests_of
from engine.export.row_recorder import (
    LEVELS,
    Key,
    Pad,
    RowRecorder,
    Slider,
    check_output,
    keys_of_player,
    pads_of_player,
    player_of_keys,
    player_of_scene,
    sliders_of_player,
)
from engine.instrument.expansion import expand
from engine.instrument.key_names import HIGHEST_KEY, plain_note_name
from engine.kernel.data.enums import Balance
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.live.audio_memory import RENDERED_AT_ONCE
from engine.live.event_queue import event_capacity
from engine.live.shared_memory import Slot
from engine.output_files import atomic_write, write_text
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.runtime.jobs import Job
from engine.runtime.kernel_choice import prepare

SOURCES = ("fdh.h", "fdh.c", "main.c", "CMakeLists.txt")
HEADER, OBJECT = "fdh_patch.h", "fdh_patch.o"  # the object has the tables
SCORE, KEYS = "score", "keys"  # parts of a library


def export_c(
    scene: Scene,
    folder: Path,
    target: str = "x86_64-linux",
    seconds: float | None = None,
    samplerate: int = 44_100,
    kernel: KernelName = KernelName.GENERAL,
) -> list[Path]:
    """Write a scene as a library in C to a folder, which is made if it is not there. Returns the files.

    target: a key of OF_LIBRARIES, or the name of one of TARGETS
    kernel: GENERAL, which comes with the engine, or SPECIAL, which is compiled for the scene

    Raises ValueError for an unknown target or a scene that cannot be exported, BuildError (a ValueError) if it cannot
    be built, OSError if a file cannot be written.
    """
    if target not in {*OF_LIBRARIES, *(target.name for target in TARGETS)}:
        raise ValueError(f"no target is called {target!r}; there are {', '.join(OF_LIBRARIES)}")
    check_output(scene, "C")
    seconds = scene.seconds if seconds is None else seconds
    players = {SCORE: player_of_scene(without_bends(scene), samplerate, kernel, seconds)}
    if players[SCORE].tables.exchanges:  # they part a block, of which fdh.c reads the whole
        raise CannotExport("a patch whose events change bodies cannot be exported to C yet")
    if scene.instrument is not None:
        players[KEYS] = player_of_keys(scene, samplerate, kernel)
    events, names = _events_of(scene, list(players.values())[-1])
    kernels, tables = LinkedKernels(target_named(target), kernel), dict[str, bytes]()
    layouts = [_add_part(part, player, kernels, tables) for part, player in players.items()]
    tables |= {"fdh_rows": bytes(events.rows), "fdh_keys": bytes(events.keys), "fdh_controls": bytes(events.controls)}
    tables["fdh_levels"] = np.array(LEVELS, np.int64).tobytes()
    numbers = _numbers(scene) | {"SAMPLERATE": samplerate, "LENGTH": frame_count(seconds, samplerate)}
    declared = f"#define FDH_KERNELS void {', '.join(f'{name}(void)' for name in kernels.entries)};"
    lines = [*names, *_defined(numbers), declared, f"#define FDH_LAYOUTS {', '.join(layouts)}"]
    return _write_files(folder, lines, {OBJECT: kernels.table_object(tables), **kernels.objects()})


def without_bends(scene: Scene) -> Scene:
    """The scene with notes that do not bend: a library has one set of tables for each body."""
    document = scene.instrument or {}
    notes = document.get("note") or []
    if not any("bend" in note for note in notes):
        return scene
    plain = [{name: value for name, value in note.items() if name != "bend"} for note in notes]
    return scene.with_expansion(expand(document | {"note": plain}))


# --- the parts


def _add_part(part: str, player: RowRecorder, kernels: LinkedKernels, tables: dict[str, bytes]) -> str:
    """Add the kernels and the tables of a part, by their names in C. Return its layout in C."""
    memory, built = player.memory, _built_of(player)
    laid_out = lay_out_player(memory, pointer_bytes=8, base=0, built=built)
    tables[f"fdh_scene_{part}"] = bytes(laid_out.content)
    tables[f"fdh_pointers_{part}"] = np.array(laid_out.pointers, np.int64).tobytes()
    kinds = prepare([built[0]], built[1], kernels.name).kinds
    entries = {name: kernels.add(request, part) for name, request in requests_of(kinds).items()}
    arrays = arrays_of_player(memory) | {"audio": memory.shared.audio, "spare": memory.shared.spare}
    numbers = {
        "size": len(laid_out.content),
        "pointer_count": len(laid_out.pointers),
        "memory": laid_out.values[MEMORY],
        "render_at": laid_out.place_of(memory.job_memory.job) + 8 * Job.RENDER_BLOCK,
        "insert_at": laid_out.place_in(MEMORY, "insert_event"),
        **{name: laid_out.place_of(array) for name, array in arrays.items() if name != "gauges"},
    }
    named = {"scene": f"fdh_scene_{part}", "pointers": f"fdh_pointers_{part}"}
    named |= {"play": entries[PLAY], "render": entries[RENDER], "insert": entries[INSERT]}
    return f"{{{', '.join(f'.{name} = {value}' for name, value in (named | numbers).items())}}}"


def _built_of(player: RowRecorder) -> tuple[Model, State]:
    """Return the model and the state of a player. Live sound has no time for as many steps of a sample as some patches
    allow: a library has."""
    if player.waiting or player.patch.accuracy == player.scene.accuracy:
        return player.model, player.state
    return build(player.patch, player.samplerate, event_capacity=event_capacity(player.patch, False))[:2]


# --- keys, pads and sliders


def _events_of(scene: Scene, player: RowRecorder) -> tuple[EventTables, list[str]]:
    """Return the tables of events, and the lines of the header that name keys, pads and sliders."""
    tables = EventTables()
    keys = [] if scene.instrument is None else keys_of_player(player)
    if player.exchanged:
        raise CannotExport("an instrument whose keys change bodies cannot be exported to C yet")
    pads = [] if keys else pads_of_player(player, velocity=1.0)
    sliders = sliders_of_player(player)
    groups = list(dict.fromkeys(key.group for key in keys if key.group is not None))
    for key in keys:
        tables.add_key(key, groups)
    for pad in pads:
        tables.add_pad(pad)
    for slider in sliders:
        tables.add_slider(slider)
    middle = min((key.number for key in keys), key=lambda number: abs(number - 60), default=0)
    numbers = {"KEYS": len(keys), "PADS": len(pads), "SLIDERS": len(sliders), "MIDDLE_KEY": middle}
    numbers |= {
        "EVENTS_OF_NOTE": max((_events_of_note(key) for key in keys), default=0),
        "EVENTS_OF_STROKE": max((len(pad.rows) for pad in pads), default=0),
        "EVENTS_OF_SETTING": max((len(slider.rows) for slider in sliders), default=0),
    }
    first = {"FIRST_SIZE": (pads[0].size or 1.0) if pads else 0.0}
    gain = f"#define FDH_GAIN {scene.level_factor or 0.0!r} /* the level of the patch, a factor on samples; 0: none */"
    lines = [*_named_keys(keys), *_named_pads(pads), *_named_sliders(sliders), *_defined(numbers | first), gain]
    return tables, lines


def _events_of_note(key: Key) -> int:
    """Events of a key that is pressed, let go, and ended for another."""
    ended = [len(key.damp[-1]), len(key.steal)]
    return sum([*(max(len(rows) for rows in levels) for levels in (key.on, key.off)), *ended])


def _named_keys(keys: list[Key]) -> list[str]:
    return _defined({f"KEY_{plain_note_name(key.number).upper()}": key.number for key in keys})


def _named_pads(pads: list[Pad]) -> list[str]:
    remarks = [f"thrown, in the patch with {pad.size:g} m/s" if pad.is_hammer else "plucked" for pad in pads]
    return _numbered("PAD", [pad.name for pad in pads], remarks)


def _named_sliders(sliders: list[Slider]) -> list[str]:
    names = [f"{s.label.replace('*/', '* /')}: " if s.label else "" for s in sliders]
    ranges = [f"{s.low:g} to {s.high:g} {s.unit}, in the patch {s.value:g}" for s in sliders]
    remarks = [name + text for name, text in zip(names, ranges, strict=True)]
    return _numbered("SLIDER", [slider.path for slider in sliders], remarks)


def _numbered(kind: str, names: list[str], remarks: list[str]) -> list[str]:
    """Return lines that number things by their names, and say what they are."""
    words = [re.sub(r"\W", "_", f"{kind}_{name}".upper(), flags=re.ASCII) for name in names]
    unique = [word if words.count(word) == 1 else f"{word}_{n}" for n, word in enumerate(words)]
    return [f"#define FDH_{word} {n} /* {text} */" for n, (word, text) in enumerate(zip(unique, remarks, strict=True))]


# --- the files


def _numbers(scene: Scene) -> dict[str, int]:
    """Return numbers of the engine and of the scene, by their names in C."""
    keyboard = {} if scene.instrument is None else scene.instrument["keyboard"]
    return {
        "PARTS": 1 if scene.instrument is None else 2,
        "CHANNELS": scene.channels,
        "POLYPHONY": keyboard.get("polyphony") or HIGHEST_KEY + 1,
        "LEVELS": len(LEVELS),
        "BLOCK": RENDERED_AT_ONCE,
        "QUEUE": RowRecorder.queue_size,
        "VALUES": VALUES_PER_EVENT,
        "EVENT": len(EventSlot),
        "START": int(EventSlot.START),
        "WRITE_INDEX": int(Slot.WRITE_INDEX),
        "READ_INDEX": int(Slot.READ_INDEX),
        "FRAME": int(Slot.FRAME),
        "MAX_ERROR": int(Balance.MAX_ERROR),
        "LARGEST": int(Balance.LARGEST),
    }


def _defined(numbers: Mapping[str, float]) -> list[str]:
    return [f"#define FDH_{name} {number}" for name, number in numbers.items()]


def _write_files(folder: Path, lines: Iterable[str], objects: Mapping[str, bytes]) -> list[Path]:
    """Write the files of a library; each is complete or not there. Returns them."""
    folder.mkdir(exist_ok=True)
    for name in SOURCES:
        write_text(folder / name, files("engine.export").joinpath("c", name).read_text("utf-8"))
    write_text(
        folder / HEADER, "\n".join(["/* Keys, pads and sliders of this patch, and numbers for fdh.c. */", *lines, ""])
    )
    for name, content in objects.items():
        with atomic_write(folder / name) as path:
            path.write_bytes(content)
    return [folder / name for name in (*SOURCES, HEADER, *objects)]
