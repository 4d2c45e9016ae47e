"""Build the Model and the State of a scene at a sample rate.

An effect that no part of the scene uses, or that has no strength (no loss, no stiffness), is not built: at first it is
ABSENT, and at the end arrays that do nothing (engine.assembly.absent_parts).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from engine.arithmetic import plain_numbers
from engine.arithmetic.elementary import square
from engine.assembly import limits
from engine.assembly.absent_parts import fill_absent_parts
from engine.assembly.array_memory import ABSENT, align_to_cache_lines
from engine.assembly.connections import check_connections, connections
from engine.assembly.contact_points import NOWHERE, BodyPoint, contact_sides, offset
from engine.assembly.contact_reach import contacts_to_build
from engine.assembly.event_table import event_table
from engine.assembly.external_forces import ForceTable, PluckPoint, force_table
from engine.assembly.free_flight import build_free_flight
from engine.assembly.friction import check_order, friction
from engine.assembly.initial_state import initial_state
from engine.assembly.islands import begins_of, find_islands
from engine.assembly.layout import Layout, segment_arrays
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_coefficients import mode_coefficients
from engine.assembly.mode_counts import fit_modes
from engine.assembly.mode_shape_rows import mode_shape_rows
from engine.assembly.modes import arrange_modes
from engine.assembly.one_way_drive import DriveForce, drive_forces
from engine.assembly.pickup_points import HeardPoint
from engine.assembly.points import find_points
from engine.assembly.refinement import build_refinement
from engine.assembly.residual_modes import count_contact_steps, with_residual_modes
from engine.assembly.step_coefficients import step_coefficients
from engine.assembly.stiffening import count_pairs
from engine.assembly.tension import stretching_bodies, tension
from engine.bodies.body import ModalBody, remember_positions
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import EventKind, Quantity
from engine.kernel.data.model import (
    Contact,
    Drive,
    ExternalForce,
    FreeMasses,
    Model,
    Pickups,
    StepCoefficients,
)
from engine.kernel.data.state import State
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent, Force

MAX_FORCE_AT_START = 1e12  # N


class BuildResult(NamedTuple):
    """Result of `build`: the Model, its State at time 0, and the Layout of both."""

    model: Model
    state: State
    layout: Layout


def build(
    scene: Scene,
    samplerate: float,
    accuracy: Accuracy | None = None,
    seconds: float = math.inf,
    *,
    one_partition_per_island: bool = False,
    event_capacity: int = 0,
    like: Sequence[ModalBody] | None = None,
    before: Layout | None = None,
) -> BuildResult:
    """Build the Model, State and Layout of a scene at a sample rate (Hz).

    accuracy: accuracy settings; those of the scene if None
    seconds:  duration of the sound; the tables of forces end there
    one_partition_per_island: also where islands are small (engine.analysis.profile measures them)
    event_capacity:     free slots on each island for events that the scene does not name (engine.live.player)
    like:               modal bodies of another build of the scene; each body gets as many modes as it has there
    before:             layout of another build with the same `like`; what has not changed since is not computed again
    Raises BuildError if a body vibrates too fast for the sample rate, if the accuracy has steps back in time
    and modes are heavily damped, or if the scene needs too much memory (engine.assembly.limits).
    """
    accuracy = accuracy or scene.accuracy
    live = event_capacity > 0 or any(getattr(event, "parameter", None) for event in scene.event)
    layout = find_layout(scene, samplerate, accuracy, seconds, live, EarlierBuild(like, before))
    stiffness = nominal_stiffness(layout)
    events, event_counts = event_table(layout, stiffness, samplerate, event_capacity)
    has_dampers = events is not ABSENT and bool((events.kind == EventKind.DAMP).any()) and not accuracy.is_refined
    modes = mode_coefficients(layout.modes, samplerate, accuracy, has_dampers)
    islands = segment_arrays(layout, event_counts, count_pairs(layout, list(stretching_bodies(layout))))
    if one_partition_per_island:
        islands = islands._replace(partition=np.arange(islands.mode.size))
    omega, weight = layout.modes.omega, layout.modes.weight if layout.modes.weight.any() else ABSENT
    step = step_coefficients(layout, modes, samplerate)
    drives = [layout.islands.of_body[layout.body_index[force.body]] for force in drive_forces(scene)]
    refinement = None
    if accuracy.is_refined:
        refinement = build_refinement(layout, accuracy, samplerate, events is not ABSENT, seconds=seconds)
    model = Model(
        samplerate=float(samplerate),
        effects=0,
        islands=islands,
        step=step,
        omega_squared=square(omega) if omega.any() else ABSENT,
        weight=weight,
        force=_external_force(layout, samplerate, seconds, accuracy),
        drive=Drive(np.array(drives)) if drives else ABSENT,
        connection=connections(layout, samplerate, step, accuracy.is_refined),
        contact=_contact(layout, step, accuracy),
        tension=tension(layout, accuracy.least_detuning),
        refinement=refinement,
        events=events,
        pickups=_pickups(layout),
        flight=build_free_flight(step, omega, weight, layout.points.pickups, samplerate),
        bodies=mode_shape_rows([layout.row(point) for point in trace_points(layout)]),
        free_masses=_free_masses(layout),
        sleep_threshold=plain_numbers.power(10.0, accuracy.silence / 20),
    )
    state = initial_state(layout, model)
    _refuse_deep(layout, state)
    model, state = fill_absent_parts(model, state)
    return BuildResult(align_to_cache_lines(model), align_to_cache_lines(state), layout)


class EarlierBuild(NamedTuple):
    """An earlier build of the scene."""

    like: Sequence[ModalBody] | None  # its modal bodies, to have as many modes of each
    before: Layout | None  # its layout, or that of a later one


def find_layout(
    scene: Scene,
    samplerate: float,
    accuracy: Accuracy,
    seconds: float,
    live: bool,
    earlier: "EarlierBuild",
) -> Layout:
    """Check that a scene can be built, and return its layout. Raises BuildError if it cannot.

    live: True if events may come that the score does not name
    earlier: what there is of another build
    """
    like, before = earlier
    known = {} if before is None else before.same_bodies(scene)
    bodies, steps = limits.build_modal_bodies(scene, samplerate, accuracy.scheme, known), count_contact_steps(accuracy)
    if like is None:
        bodies = with_residual_modes(scene, bodies, samplerate, steps)
    else:
        bodies = fit_modes(scene, bodies, samplerate, steps, like, known)
    bodies = [known.get(n) or body._replace(shape=remember_positions(body.shape)) for n, body in enumerate(bodies)]
    limits.check_sizes(scene, bodies)
    limits.check_forces(scene, samplerate, seconds)
    check_order(scene, accuracy)
    system = ModalSystem(scene, bodies, {body.name: number for number, body in enumerate(scene.body)})
    is_plain = accuracy.scheme == "exact" and accuracy.order == 2 and accuracy.max_error is None
    step = 1 / (samplerate * accuracy.substeps) if is_plain else None
    islands = find_islands(system, contacts_to_build(system, live), step)
    limits.check_islands(scene, islands)
    check_connections(system, islands, accuracy, samplerate)
    modes = arrange_modes(system, islands)
    return Layout(scene, bodies, system.body_index, islands, modes, find_points(system, islands, modes))


def nominal_stiffness(layout: Layout) -> np.ndarray:
    """Return the stiffness of each contact point, N/m^α. If it is 0 at first, return the first value that an event
    sets."""
    later: dict[str | None, float] = {}
    for event in layout.scene.event:
        if isinstance(event, ChangeEvent) and event.stiffness:
            later.setdefault(event.contact, event.stiffness)
    points = layout.islands.contact_points
    return np.array([point.stiffness or later[layout.touching[k].name] for k, point in points])


def trace_points(layout: Layout) -> list[BodyPoint]:
    """Return the point at which each body is traced: its first pickup, or else its first contact, or else its first
    force, or else, of one that moves as a whole, itself; NOWHERE of others."""
    scene, points = layout.scene, dict[str, BodyPoint]()
    for pickup in scene.pickup:
        everywhere = pickup.quantity == "pressure" and pickup.at is None
        if pickup.quantity not in ("force", "end_force", "tension") and not everywhere:
            points.setdefault(pickup.body, layout.point_of(pickup))
    for k, contact_point in layout.islands.contact_points:
        for side in contact_sides(layout.touching[k], contact_point):
            if side.body is not None:
                points.setdefault(side.body, side._replace(factor=1.0))
    for force in layout.islands.forces:
        points.setdefault(force.body, layout.point_of(force))
    for body in scene.body:
        if body.IS_LUMPED:
            points.setdefault(body.name, BodyPoint(body.name, None, 1.0))
    return [points.get(scene.body[b].name, NOWHERE) for b in layout.islands.body_order]


def _free_masses(layout: Layout) -> FreeMasses:
    """Return the modes of free masses, counted from the first mode of their island."""
    modes = layout.modes
    is_audible = np.zeros(len(modes.of_island), np.bool_)
    for pickup in layout.scene.pickup:
        number = layout.body_index[pickup.body]
        if pickup.quantity != "force" and modes.is_free[modes.of_body[number]].any():
            is_audible[layout.islands.of_body[number]] = True
    return FreeMasses(np.concatenate([np.flatnonzero(modes.is_free[m]) for m in modes.of_island]), is_audible)


def _contact(layout: Layout, step: StepCoefficients, accuracy: Accuracy) -> Contact:
    """Return the contacts of a layout; ABSENT without any."""
    if not layout.points.contacts:
        return ABSENT
    contacts = [(layout.touching[k], point) for k, point in layout.islands.contact_points]
    ours, theirs = zip(*layout.points.contacts, strict=True)
    return Contact(
        rows=mode_shape_rows(ours),
        other_rows=mode_shape_rows(theirs) if any(row.phi.size for row in theirs) else ABSENT,
        friction=friction(layout, step.contact.coupling),
        has_power_laws=_has_power_laws(layout),
        nominal_stiffness=nominal_stiffness(layout),
        nominal_barrier=np.array([offset(contact, point) for contact, point in contacts]),
        tolerance=accuracy.tolerance,
        max_rounds=accuracy.iterations,
    )


def _has_power_laws(layout: Layout) -> np.ndarray:
    """Return 1 for each island whose contacts have no law but that of a power."""
    has = np.array([layout.touching[k].has_power_law for k, _ in layout.islands.contact_points])
    return np.array([has[first:last].all() for first, last in pairwise(layout.islands.contact_begins)], np.int64)


def _external_force(layout: Layout, samplerate: float, seconds: float, accuracy: Accuracy) -> ExternalForce:
    """Return the external forces of a layout; ABSENT without any."""
    forces = layout.islands.forces
    if not forces:
        return ABSENT
    tables = [_force_table(layout.scene, force, samplerate, seconds, accuracy) for force in forces]
    begins = begins_of([table.values.size for table in tables])
    # the number of the point that strings drive by each force, -1 for other forces
    driven = np.array([force.number if isinstance(force, DriveForce) else -1 for force in forces], dtype=np.int64)
    return ExternalForce(
        rows=mode_shape_rows(layout.points.forces),
        start=np.array([table.start for table in tables], dtype=np.int64),
        table_begin=begins[:-1],
        table_end=begins[1:],
        table=np.concatenate([table.values for table in tables]),
        tail=np.array([table.tail for table in tables]),
        drive=driven if np.any(driven >= 0) else ABSENT,
    )


def _force_table(
    scene: Scene, force: Force | PluckPoint | DriveForce, samplerate: float, seconds: float, accuracy: Accuracy
) -> ForceTable:
    """Return the table of a force; it is empty if strings or the score make the force. Raises BuildError if its file
    cannot be read to its end."""
    if isinstance(force, DriveForce | PluckPoint):
        return ForceTable(0, np.zeros(0), 0.0)
    try:
        return force_table(force, samplerate, seconds, accuracy)
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        number = scene.force.index(force)
        raise limits.unreadable_file(f"force[{number}]", error) from None


def _pickups(layout: Layout) -> Pickups:
    """Return the pickups of a layout."""
    pickups = layout.points.pickups
    pushes = [list(_find_pushes(layout, heard)) for heard in pickups]
    begins = begins_of([len(of_pickup) for of_pickup in pushes])
    return Pickups(
        rows=mode_shape_rows([heard.row for heard in pickups]),
        quantity=np.array([heard.quantity for heard in pickups], dtype=np.int64),
        channel=np.array([heard.channel for heard in pickups], dtype=np.int64),
        gain=np.array([heard.gain for heard in pickups]),
        contact_begin=begins[:-1],
        contact_end=begins[1:],
        contact=np.array([slot for of_pickup in pushes for slot, _ in of_pickup], dtype=np.int64),
        contact_sign=np.array([sign for of_pickup in pushes for _, sign in of_pickup], dtype=float),
    )


def _find_pushes(layout: Layout, heard: HeardPoint) -> Iterator[tuple[int, float]]:
    """Yield the contacts of the body of a pickup of quantity force, counted from the first of their island, with the
    sign of their push on it."""
    islands = layout.islands
    island = islands.of_body[layout.body_index[heard.pickup.body]]
    inside = slice(*islands.contact_begins[island : island + 2])
    is_force = heard.quantity == Quantity.FORCE and heard.pickup.quantity == "force"
    for slot, (k, point) in enumerate(islands.contact_points[inside] if is_force else ()):
        for side in contact_sides(layout.touching[k], point):
            if side.body == heard.pickup.body:
                yield slot, -side.factor


def _refuse_deep(layout: Layout, state: State) -> None:
    """Raise BuildError if contacts begin deeper than any force could have brought them."""
    faults: list[Fault] = []
    for slot, (k, _) in enumerate(layout.islands.contact_points):
        depth, exponent = float(state.compression[slot]), float(state.exponent[slot])
        unit = float(state.potential_coefficient[slot])
        power = plain_numbers.exp_or_inf(exponent * plain_numbers.log(depth)) if depth > 0.0 else 0.0
        force = unit * (exponent + 1) * power
        if force > MAX_FORCE_AT_START:
            message = f"begins with a compression of {depth:.3g} m, at which it pushes with {force:.1e} N"
            remedy = f"at most {MAX_FORCE_AT_START:g} N is allowed; check the signs of gap and side"
            faults.append(Fault(f"contact[{k}]", f"{message}; {remedy}"))
    if faults:
        raise BuildError(*(faults[:1] if len({fault.path for fault in faults}) == 1 else faults))
