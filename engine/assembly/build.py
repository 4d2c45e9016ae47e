"""Build the Model and the State of a scene at a sample rate.

An effect that no part of the scene uses, or that has no strength (no loss, no stiffness), is not built: it is None.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.assembly import limits
from engine.assembly.array_memory import align_to_cache_lines, to_single_precision
from engine.assembly.connection_coordinates import changed_connections
from engine.assembly.connections import check_connections, connections
from engine.assembly.contact_points import NOWHERE, BasisUse, BodyPoint
from engine.assembly.contact_reach import contacts_to_build
from engine.assembly.event_table import event_table
from engine.assembly.external_forces import ForceTable, force_table
from engine.assembly.free_flight import PickupRow, build_free_flight
from engine.assembly.initial_state import initial_state
from engine.assembly.layout import Layout
from engine.assembly.mode_coefficients import (
    MAX_DAMPING_BACKWARDS,
    SCHEMES,
    damped_coefficients,
    end_loss,
    loses_in_drift,
)
from engine.assembly.mode_counts import fit_modes, with_residual_modes
from engine.assembly.mode_shape_rows import mode_shape_rows
from engine.assembly.one_way_drive import DriveForce
from engine.assembly.refinement import build_refinement
from engine.assembly.step_coefficients import ModeCoefficients, all_factors, contact_basis_tables, step_coefficients
from engine.bodies.body import ModalBody
from engine.faults import BuildError, Fault
from engine.kernel.data.enums import EventKind, Quantity
from engine.kernel.data.laws import NO_NUMBERS, select_law
from engine.kernel.data.model import Contact, ContactBasis, Drive, ExternalForce, FreeMasses, ModalLoss, Model, Pickups
from engine.kernel.data.state import State
from engine.output_files import error_reason
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene
from engine.patch.tables import ChangeEvent

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
    variable_exponents: bool = False,
    like: Sequence[ModalBody] | None = None,
) -> BuildResult:
    """Build the Model, State and Layout of a scene at a sample rate (Hz).

    accuracy: accuracy settings; those of the scene if None
    seconds:  duration of the sound; the tables of forces end there
    one_partition_per_island: also where islands are small (engine.analysis.profile measures them)
    event_capacity:     free slots on each island for events that the scene does not name (engine.live.player)
    variable_exponents: True if exponents may change beyond what the score says
    like:               modal bodies of another build of the scene; each body gets as many modes as it has there
    Raises BuildError if a body vibrates too fast for the sample rate, if the accuracy has steps back in time
    and modes are heavily damped, or if the scene needs too much memory (engine.assembly.limits).
    """
    accuracy = accuracy or scene.accuracy
    live = event_capacity > 0 or any(getattr(event, "parameter", None) for event in scene.event)
    layout = check_and_layout(scene, samplerate, accuracy, seconds, live, like)
    check_connections(layout, accuracy, samplerate)
    events, event_begins = event_table(layout, nominal_stiffness(layout), samplerate, event_capacity)
    has_dampers = events is not None and bool((events.kind == EventKind.DAMP).any()) and not accuracy.is_refined
    modes = mode_coefficients(layout, samplerate, accuracy, has_dampers)
    bases = np.concatenate([[0], np.cumsum([rank for _, rank in layout.contact_shapes])])
    islands = layout.islands._replace(event=event_begins, basis=bases.astype(np.int64))
    if one_partition_per_island:
        islands = islands._replace(partition=np.arange(event_begins.size))
    omega, weights = layout.concatenate_modes("omega"), layout.weights()
    step = step_coefficients(layout, modes, samplerate)
    weight = weights if weights.any() else None
    model = Model(
        samplerate=float(samplerate),
        islands=islands,
        step=step,
        omega_squared=omega**2 if omega.any() else None,
        weight=weight,
        force=_external_force(layout, samplerate, seconds),
        drive=None if layout.driven_islands is None else Drive(layout.driven_islands),
        connection=connections(layout, samplerate, step, weight, accuracy.is_refined),
        contact=_contact(layout, modes, accuracy, samplerate, variable_exponents),
        refinement=build_refinement(layout, modes.kick, accuracy, samplerate) if accuracy.is_refined else None,
        events=events,
        pickups=_pickups(layout),
        flight=build_free_flight(step, omega, weight, pickup_rows(layout), samplerate),
        bodies=mode_shape_rows([layout.row(point) for point in trace_points(layout)]),
        free_masses=_free_masses(layout),
        sleep_threshold=10 ** (accuracy.silence / 20),
    )
    state = initial_state(layout, model)
    _refuse_deep(layout, state)
    if accuracy.precision == "float32":
        model, state = to_single_precision(model), to_single_precision(state)
    return BuildResult(align_to_cache_lines(model), align_to_cache_lines(state), layout)


def check_and_layout(
    scene: Scene,
    samplerate: float,
    accuracy: Accuracy,
    seconds: float,
    live: bool,
    like: Sequence[ModalBody] | None = None,
) -> Layout:
    """Check that a scene can be built, and return its layout. Raises BuildError if it cannot.

    live: True if events may come that the score does not name
    like: modal bodies of another build, to have as many modes of each
    """
    modal_bodies = limits.build_modal_bodies(scene, samplerate, accuracy.scheme)
    if like is None:
        modal_bodies = with_residual_modes(scene, modal_bodies, samplerate)
    else:
        modal_bodies = fit_modes(scene, modal_bodies, samplerate, like)
    limits.check_sizes(scene, modal_bodies)
    limits.check_forces(scene, samplerate, seconds)
    names = {c.name for c in scene.connection if c.name is not None} if live else changed_connections(scene)
    variable = frozenset(name for name in names if name is not None)
    is_plain = accuracy.scheme == "exact" and accuracy.order == 2
    step = 1 / (samplerate * accuracy.substeps) if is_plain else None
    layout = Layout(scene, modal_bodies, contacts_to_build(scene, modal_bodies, live), variable, step)
    limits.check_islands(layout)
    return layout


def mode_coefficients(layout: Layout, samplerate: float, accuracy: Accuracy, has_dampers: bool) -> ModeCoefficients:
    """Return the step coefficients of each mode. Raises BuildError if damping is too heavy for steps back in time.

    has_dampers: True if events may damp modes in steps of a whole sample: their loss is a part of the modes'
                 (engine.kernel.modes.event_dampers)
    """
    omega, sigma, h = layout.concatenate_modes("omega"), layout.concatenate_modes("sigma"), 1.0 / samplerate
    if accuracy.order > 2 and sigma.max(initial=0.0) * h > MAX_DAMPING_BACKWARDS:
        message = f"order {accuracy.order} has steps back in time, in which heavy damping would create energy"
        limit = f"allows decay rates up to {MAX_DAMPING_BACKWARDS * samplerate:.4g} 1/s ({sigma.max():.4g} here)"
        raise BuildError(Fault("accuracy.order", f"{message}, and {limit}; use order = 2 with substeps"))
    damped = loses_in_drift(omega, sigma, h, accuracy)
    kick, drift, decay, drag, dragged = np.empty((5, omega.size))
    kick[~damped], drift[~damped] = SCHEMES[accuracy.scheme](omega[~damped], sigma[~damped], h)
    decay[~damped], drag[~damped], dragged[~damped] = np.exp(-sigma[~damped] * h), 1.0, 0.0
    if damped.any():
        values = damped_coefficients(omega[damped], sigma[damped], h)
        kick[damped], drift[damped], decay[damped], drag[damped], dragged[damped] = values
    loss = end_loss(decay) if sigma.any() or has_dampers else None
    return ModeCoefficients(kick, drift, loss, ModalLoss(drag, dragged) if damped.any() else None)


def nominal_stiffness(layout: Layout) -> np.ndarray:
    """Return the stiffness of each contact point, N/m^α. If it is 0 at first, return the first value that an event
    sets."""
    later: dict[str | None, float] = {}
    for event in layout.scene.event:
        if isinstance(event, ChangeEvent) and event.stiffness:
            later.setdefault(event.contact, event.stiffness)
    points = layout.contact_points
    return np.array([point.stiffness or later[layout.scene.contact[k].name] for k, point in points])


def trace_points(layout: Layout) -> list[BodyPoint]:
    """Return the point at which each body is traced: its first pickup, or else its first contact, or else its first
    force."""
    scene, points = layout.scene, dict[str, BodyPoint]()
    for pickup in scene.pickup:
        everywhere = pickup.quantity == "pressure" and pickup.at is None
        if pickup.quantity not in ("force", "end_force") and not everywhere and pickup.body not in points:
            points[pickup.body] = layout.point_of(pickup)
    for k, contact_point in layout.contact_points:
        for side in layout.contact_sides(k, contact_point):
            if side.body is not None and side.body not in points:
                points[side.body] = BodyPoint(side.body, side.position, 1.0)
    for force in layout.forces:
        if force.body not in points:
            points[force.body] = layout.point_of(force)
    return [points.get(scene.body[b].name, NOWHERE) for b in layout.body_order]


def _free_masses(layout: Layout) -> FreeMasses | None:
    """Return the modes of free masses, counted from the first mode of their island; None without any."""
    free, islands = np.flatnonzero(layout.free_mass_modes), layout.islands
    if free.size == 0:
        return None
    is_audible = np.zeros(islands.free_mass.size - 1, np.bool_)
    for pickup in layout.scene.pickup:
        number = layout.body_index[pickup.body]
        if pickup.quantity != "force" and np.any(layout.free_mass_modes[layout.global_modes(number)]):
            is_audible[layout.island_of_body[number]] = True
    return FreeMasses(free - np.repeat(islands.mode[:-1], np.diff(islands.free_mass)), is_audible)


def _contact(
    layout: Layout, modes: ModeCoefficients, accuracy: Accuracy, samplerate: float, variable_exponents: bool
) -> Contact | None:
    """Return the contacts of a layout; None without any."""
    if not layout.contact_points:
        return None
    scene = layout.scene
    exponents = np.array([scene.contact[k].exponent for k, _ in layout.contact_points])
    changed = any(isinstance(e, ChangeEvent) and e.exponent is not None for e in scene.event)
    others = [b for _, b in layout.contact_rows]
    return Contact(
        law=select_law(exponents, variable_exponents or changed)(NO_NUMBERS, NO_NUMBERS),
        rows=mode_shape_rows([layout.row(a) for a, _ in layout.contact_rows]),
        other_rows=mode_shape_rows([layout.row(b) for b in others]) if any(b.body for b in others) else None,
        basis=_contact_basis(layout, modes, samplerate),
        nominal_stiffness=nominal_stiffness(layout),
        nominal_barrier=np.array([layout.offset(k, point) for k, point in layout.contact_points]),
        tolerance=accuracy.tolerance,
        max_rounds=accuracy.iterations,
    )


def _contact_basis(layout: Layout, modes: ModeCoefficients, step_rate: float) -> ContactBasis | None:
    """Return the bases of the contacts of islands that have one; None if no island has."""
    tables = contact_basis_tables(layout, modes, all_factors(layout, modes, step_rate))
    if not tables.rows:
        return None
    is_first = [use is BasisUse.FIRST for use in layout.basis_uses if use is not BasisUse.NONE]
    return ContactBasis(
        rows=mode_shape_rows(tables.rows),
        at_contacts_begin=np.repeat(_begins(tables.at_contacts), tables.ranks),
        products_begin=np.repeat(_begins(tables.products), tables.ranks),
        is_first=np.repeat(np.array(is_first, np.int64), tables.ranks),
    )


def _begins(arrays: list[np.ndarray]) -> np.ndarray:
    """Return the position of the first number of each array if the arrays are joined end to end."""
    return np.cumsum([0, *(array.size for array in arrays[:-1])])


def _external_force(layout: Layout, samplerate: float, seconds: float) -> ExternalForce | None:
    """Return the external forces of a layout; None without any."""
    if not layout.force_order:
        return None
    forces = [layout.forces[j] for j in layout.force_order]
    tables = [_force_table(layout.scene, force, samplerate, seconds) for force in forces]
    begins = np.cumsum([0] + [t.values.size for t in tables]).astype(np.int64)
    return ExternalForce(
        rows=mode_shape_rows([layout.row(point) for point in layout.force_points]),
        start=np.array([t.start for t in tables], dtype=np.int64),
        table_begin=begins[:-1],
        table_end=begins[1:],
        table=np.concatenate([t.values for t in tables]),
        tail=np.array([t.tail for t in tables]),
        scale=np.ones(len(tables)),
        drive=_driven_points(forces),
    )


def _driven_points(forces: Sequence[object]) -> np.ndarray | None:
    """Return the number of the point that strings drive by each force, -1 for other forces [forces]; None if all are
    -1."""
    points = np.array([force.number if isinstance(force, DriveForce) else -1 for force in forces], dtype=np.int64)
    return points if np.any(points >= 0) else None


def _force_table(scene: Scene, force: object, samplerate: float, seconds: float) -> ForceTable:
    """Return the table of a force; it is empty if strings make the force. Raises BuildError if its file cannot be read
    to its end."""
    if isinstance(force, DriveForce):
        return ForceTable(0, np.zeros(0), 0.0)
    try:
        return force_table(force, samplerate, seconds)  # type: ignore[arg-type]
    except (OSError, RuntimeError, TypeError, ValueError) as error:  # it was there when the patch was read
        path = f"force[{scene.force.index(force)}].file"  # type: ignore[arg-type]
        message = f"cannot be read as audio ({error_reason(error)}); give a WAV, FLAC or OGG file"
        raise BuildError(Fault(path, message)) from None


def pickup_rows(layout: Layout) -> list[PickupRow]:
    """Return the mode shapes and the quantity of each pickup point of a layout."""
    return [PickupRow(layout.row(heard.point), heard.quantity) for heard in layout.heard_points]


def _pickups(layout: Layout) -> Pickups:
    """Return the pickups of a layout. A pickup of quantity force lists the contacts of its body, with the sign of their
    push on it."""
    begin, contact, sign = [0], list[int](), list[float]()
    for heard in layout.heard_points:
        island = layout.island_of_body[layout.body_index[heard.pickup.body]]
        is_force = heard.quantity == Quantity.CONTACT_FORCE
        inside = slice(*layout.islands.contact[island : island + 2]) if is_force else slice(0)
        for slot, (k, point) in enumerate(layout.contact_points[inside]):
            for side in layout.contact_sides(k, point):
                if side.body == heard.pickup.body:
                    contact.append(slot)
                    sign.append(-side.factor)
        begin.append(len(contact))
    return Pickups(
        rows=mode_shape_rows([layout.row(heard.point) for heard in layout.heard_points]),
        quantity=np.array([heard.quantity for heard in layout.heard_points], dtype=np.int64),
        channel=np.array([heard.channel for heard in layout.heard_points], dtype=np.int64),
        gain=np.array([heard.gain for heard in layout.heard_points]),
        contact_begin=np.array(begin[:-1], dtype=np.int64),
        contact_end=np.array(begin[1:], dtype=np.int64),
        contact=np.array(contact, dtype=np.int64),
        contact_sign=np.array(sign, dtype=float),
    )


def _refuse_deep(layout: Layout, state: State) -> None:
    """Raise BuildError if contacts begin deeper than any force could have brought them."""
    faults: list[Fault] = []
    for slot, (k, _) in enumerate(layout.contact_points):
        depth, exponent = float(state.compression[slot]), float(state.exponent[slot])
        with np.errstate(over="ignore"):
            unit = float(state.potential_coefficient[slot])
            force = unit * (exponent + 1) * np.float64(max(depth, 0.0)) ** exponent
        if force > MAX_FORCE_AT_START:
            message = f"begins with a compression of {depth:.3g} m, at which it pushes with {force:.1e} N"
            remedy = f"at most {MAX_FORCE_AT_START:g} N is allowed; check the signs of gap and side"
            faults.append(Fault(f"contact[{k}]", f"{message}; {remedy}"))
    if faults:
        raise BuildError(*(faults[:1] if len({fault.path for fault in faults}) == 1 else faults))
