"""A player as bytes: all that the audio thread reads and writes, for a program that runs its kernels without Python."""

from itertools import pairwise
from typing import Any

import numpy as np

from engine.compiler.kinds import Kind
from engine.export.scene_bytes import NUMBER_BYTES, SceneBytes
from engine.kernel.data.axes import map_arrays
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.live.audio_memory import AudioMemory
from engine.live.kernels import KINDS, PLAY_INTO
from engine.live.shared_memory import Slot
from engine.runtime.exchange import INSERT_USE
from engine.runtime.job_memory import RENDER_USE
from engine.runtime.jobs import Job

MEMORY, STATE = "memory", "state"
RENDER_BLOCK, INSERT_EVENT = 1, 2  # places in a table of functions: the addresses of the kernels that are called so

PLAY, RENDER, INSERT = "play", "render", "insert"  # the kernels of a player
Requests = dict[str, tuple[str, str, tuple[Kind, ...]]]  # module, function and kinds of each


def requests_of(kinds: tuple[Kind, Kind]) -> Requests:
    """Return the kernels that a player runs. kinds: of pointers to its model and to its state"""
    uses = {RENDER: RENDER_USE, INSERT: INSERT_USE}
    wanted = {name: (u.kernel.module, u.kernel.function, (*kinds, *u.others)) for name, u in uses.items()}
    return {PLAY: (PLAY_INTO.module, PLAY_INTO.function, KINDS[PLAY_INTO])} | wanted


def lay_out_player(
    memory: AudioMemory, pointer_bytes: int, base: int, built: tuple[Model, State] | None = None
) -> SceneBytes:
    """Lay out the memory of a player that has not begun. Its value MEMORY is what the kernels take.

    base:  address that the bytes will have
    built: what is to be played instead of the player's models and state
    """
    job_memory = memory.job_memory
    laid_out = SceneBytes(pointer_bytes, base)
    played = [handle.value for handle in memory.model_handles] if built is None else [built[0]]
    models = [f"model {n}" for n in range(len(played))]
    for name, model in zip(models, played, strict=True):
        reduced = without_unused_flights(model)
        laid_out.add(name, reduced)
        laid_out.stand_for(model, reduced, used_numbers(model))
    laid_out.add(STATE, memory.state_handle.value if built is None else built[1])
    outputs = [f"output {n}" for n in range(len(job_memory.outputs))]
    for name, handle in zip(outputs, job_memory.outputs, strict=True):
        laid_out.add(name, handle.value)
    _add_job(laid_out, memory, models[0], outputs)
    short = np.zeros((1, memory.shared.record.shape[1]), np.float32)  # nobody reads what was played
    shared = memory.shared._replace(record=short, models=np.zeros(len(models), np.int64))
    laid_out.add(MEMORY, shared)
    laid_out.set_address(laid_out.place_in(MEMORY, "job"), "job")
    laid_out.set_address(laid_out.place_in(MEMORY, "state"), STATE)
    laid_out.set_number(laid_out.place_in(MEMORY, "insert_event"), INSERT_EVENT)
    laid_out.set_number(_number(laid_out, shared.counters, Slot.CLOCK), 0)  # PortAudio calls nothing there
    for n, name in enumerate(models):
        laid_out.set_address(_number(laid_out, shared.models, n), name)
    return laid_out


def arrays_of_player(memory: AudioMemory) -> dict[str, np.ndarray]:
    """Return the arrays by which a program without Python sends events and reads how it sounds."""
    shared = memory.shared
    return {
        "counters": shared.counters,
        "gauges": shared.gauges,
        "events": shared.events,
        "values": shared.values,
        "balance": memory.job_memory.balance,
    }


def _number(laid_out: SceneBytes, array: np.ndarray, number: int) -> int:
    """Return the place of a number of an array of 64-bit integers."""
    return laid_out.place_of(array) + NUMBER_BYTES * number


def without_unused_flights(model: Model) -> Model:
    """Return a model whose tables of free flight are zero for islands with connections, which never fly: they would be
    half of an instrument."""
    connected = np.flatnonzero(np.diff(model.islands.connection))
    flight, rows = model.flight, model.pickups.rows
    if not len(connected):
        return model
    is_unused = np.zeros(flight.bound_per_speed.size, bool)
    for n in connected:
        is_unused[model.islands.mode[n] : model.islands.mode[n + 1]] = True

    def emptied(table: Any) -> Any:
        if isinstance(table, np.ndarray):
            return np.where(is_unused, 0.0, table) if table.size else table
        return table if table is None else table._replace(**{k: emptied(v) for k, v in table._asdict().items()})

    pickup_tables = flight.pickup_tables.copy()
    for n in connected:
        for r in range(model.islands.pickup[n], model.islands.pickup[n + 1]):
            begin, count = rows.offset[r], rows.mode_end[r] - rows.mode_begin[r]
            pickup_tables[begin : begin + count] = 0.0
    changed = {name: emptied(getattr(flight, name)) for name in ("motion", "motion_low", "part", "loss")}
    return model._replace(flight=flight._replace(**changed, pickup_tables=pickup_tables))


def used_numbers(model: Model) -> Model:
    """Return a model whose tables of free flight are 0 where they are not used, and else 1."""
    flight = map_arrays(lambda array, items: np.ones_like(array), model.flight)
    return without_unused_flights(model._replace(flight=flight))


def _add_job(laid_out: SceneBytes, memory: AudioMemory, model: str, outputs: list[str]) -> None:
    """Add the job of a block, and all that it names by address."""
    job_memory = memory.job_memory
    job, addresses = job_memory.job, job_memory.addresses
    laid_out.add("job", job)
    named = {Job.MODEL: model, Job.STATE: STATE, Job.AUDIO: job_memory.audio, Job.BALANCE: job_memory.balance}
    named |= {Job.LEDGER: job_memory.ledger}
    parts = {
        Job.OUTPUTS: outputs,
        Job.AUDIOS: [handle.value.audio for handle in job_memory.outputs],
        Job.LEDGERS: [handle.value.ledger for handle in job_memory.outputs],
    }
    for slot, what in named.items():
        if not isinstance(what, str):
            laid_out.add(slot.name, what)
        laid_out.set_address(_number(laid_out, job, slot), what)
    for slot, each in parts.items():
        laid_out.add(slot.name, addresses[slot])
        laid_out.set_address(_number(laid_out, job, slot), addresses[slot])
        for n, what in enumerate(each):
            laid_out.set_address(_number(laid_out, addresses[slot], n), what)
    laid_out.set_number(_number(laid_out, job, Job.RENDER_BLOCK), RENDER_BLOCK)
    laid_out.set_number(_number(laid_out, job, Job.CREW), 0)


def leave_out_products(laid_out: SceneBytes, model: Model) -> list[list[int]]:
    """Set the products t·Φ and v·Φ of contacts and connections to zero in the bytes: they would be a fifth of an
    instrument. Return for each row of mode shapes the addresses of Φ, of t and v of its modes, and of both products;
    and how many modes it has."""
    h, islands, left_out = model.step, model.islands, list[list[int]]()
    contact, connection = (model.contact, h.contact), (model.connection, h.connection)
    for (rows_of, products_of), items in ((contact, islands.contact), (connection, islands.connection)):
        for name in ("rows", "other_rows"):
            rows, products = getattr(rows_of, name, None), getattr(products_of, name, None)
            if rows is None or products is None:
                continue
            tables = (rows.phi, h.kick, h.drift, products.kick_phi, products.drift_phi)
            places = [laid_out.place_of(table) for table in tables]
            for n, (first, last) in enumerate(pairwise(items)):
                for r in range(first, last):
                    at, mode = int(rows.offset[r]), int(islands.mode[n] + rows.mode_begin[r])
                    count = int(rows.mode_end[r] - rows.mode_begin[r])
                    if not _is_product(tables, at, mode, count):
                        continue
                    for place in places[3:]:
                        begin = place + 8 * at
                        laid_out.content[begin : begin + 8 * count] = bytes(8 * count)
                    starts = [p + 8 * n for p, n in zip(places, (at, mode, mode, at, at), strict=True)]
                    left_out.append([*(laid_out.base + start for start in starts), count])
    return left_out


def _is_product(tables: tuple[np.ndarray, ...], at: int, mode: int, count: int) -> bool:
    """True if the last two tables are products of the first with the others, to the last bit."""
    phi, kick, drift, kick_phi, drift_phi = tables
    row, modes = slice(at, at + count), slice(mode, mode + count)
    pairs = (kick_phi[row], kick[modes] * phi[row]), (drift_phi[row], drift[modes] * phi[row])
    return count > 1 and all(np.array_equal(a, b) for a, b in pairs)


def leave_out_symmetry(laid_out: SceneBytes, model: Model) -> list[list[int]]:
    """Replace what lies below the diagonal of each matrix B of contacts by how its bits, as integers, differ from those
    above: rounding apart, B is symmetric. Return the address and the size of each."""
    coupling, islands = model.step.contact.coupling, model.islands
    bits, left_out, place = coupling.view(np.int64).copy(), list[list[int]](), laid_out.place_of(coupling)
    for first, size in zip(islands.compliance[:-1], np.diff(islands.contact), strict=True):
        if size < 2 or first + size**2 > bits.size:
            continue
        square = bits[first : first + size**2].reshape(size, size)
        below = np.tril_indices(size, -1)
        square[below] -= square.T[below]
        left_out.append([laid_out.base + place + 8 * int(first), int(size)])
    laid_out.content[place : place + bits.nbytes] = bits.tobytes()
    return left_out
