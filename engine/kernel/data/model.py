"""The `Model`: all that does not change while a scene sounds.

What a scene lacks are arrays without items, or of numbers that do nothing (engine.assembly.absent_parts): every scene
has all fields but `refinement`. `effects` says what it has (engine.kernel.data.effects).

Bodies are sets of modes; modes, contacts, forces and pickups of one island lie beside each other in all arrays, and
indices of modes and contacts count from their island's first. Coordinates are mass-normalised: displacement in √kg·m,
momentum in √kg·m/s, mode shapes Φ in 1/√kg (docs/design.md, sec. 1).
"""

from typing import Annotated, Any, NamedTuple

import numpy as np

from engine.kernel.data.axes import (
    Axis,
    Items,
    PerCompliance,
    PerConnection,
    PerConnectionContact,
    PerConnectionInt,
    PerConnectionPair,
    PerConnectionPartInt,
    PerContact,
    PerDriveInt,
    PerEvent,
    PerEventInt,
    PerForce,
    PerForceInt,
    PerFreeMassInt,
    PerIslandBool,
    PerIslandInt,
    PerMode,
    PerModeFactor,
    PerModeShape,
    PerPickup,
    PerPickupInt,
    PerRowInt,
    PerShape,
    Shared,
    SharedInt,
)
from engine.kernel.data.enums import (
    FLIGHT_FRAMES,
    FLIGHT_PART,
    ForceNumber,
    MovingEnd,
    PairOnBody,
    StiffenedMatrix,
    StretchFactor,
)


class ModeShapeRows(NamedTuple):
    """Mode shapes at points: row r weighs modes mode_begin[r]:mode_end[r] of its island with phi[offset[r]:].

    Indices are unsigned, or every use would first be checked for a negative one.
    """

    mode_begin: PerRowInt
    mode_end: PerRowInt
    offset: PerRowInt
    phi: PerShape  # Φ, 1/√kg, all rows one after the other


class RowCoefficients(NamedTuple):
    """Motion of the points of mode shape rows in a step of length h; counted as their phi."""

    kick_phi: PerShape  # t·Φ: momentum per newton in half a kick
    drift_phi: PerShape  # v·Φ: displacement at the point per momentum in a drift


class ModalLoss(NamedTuple):
    """Loss of momentum, once in a step: p ← d·p (paper, eq. 36)."""

    decay_factor: PerModeFactor  # d = exp(-σh) for a half-step
    dissipation_factor: PerMode  # energy lost over p², (1 - d²)/2 for a half-step


class ConnectionCoefficients(NamedTuple):
    """Coefficients of an island's connections that depend on the length of a step; their forces are linear in their
    extensions s and in the moves g that the coming drift would bring without them: f = X·s + Y·g.

    X and Y hold for the stiffness and the damping that they were made for, and so does the compliance of contacts;
    where these have changed, they are made again (engine.kernel.interactions.connection_factors).
    """

    rows: RowCoefficients  # of Connections.rows
    compliance: PerConnectionPair  # B, m/N: how far a force at one moves another over the step
    force_per_extension: PerConnectionPair  # X, N/m, column by column: the forces lie in lanes
    force_per_move: PerConnectionPair  # Y, N/m, likewise
    step_rate: PerConnection  # 1/s, one over the length of the step; 0 where dampers act outside it
    made_for_stiffness: PerConnection  # N/m
    made_for_damping: PerConnection  # kg/s
    contact_moves: PerConnectionContact  # m/N: how far a force at a contact moves all connections, a row for each
    contact_compliance: PerCompliance  # m/N: of contacts, if nothing were connected


class ContactCoefficients(NamedTuple):
    """Coefficients of each contact that depend on the length of a step."""

    rows: RowCoefficients  # of Contact.rows
    other_rows: RowCoefficients
    compliance: PerContact  # B_kk, m/N: displacement per newton over the step
    compliance_low: PerContact  # m/N: what rounding cut from B_kk
    loss_rate: PerContact  # μ/h, 1/m: Hunt-Crossley loss (paper, eq. 41)
    coupling: PerCompliance  # B of each island, m/N; where an island has several contacts
    duration: PerContact  # s: length of the step; where there is friction
    only_kick_phi: PerModeShape  # t·Φ of the only contact of an island, of both bodies; or zeros


class StepCoefficients(NamedTuple):
    """Everything that depends on the length h of a step.

    A step is half a kick, drift, half a kick (engine.kernel.modes.mode_step). In Refinement.stages each array has one
    row more in front: one for each kind of stage.
    """

    kick: PerMode  # t, s
    drift: PerMode  # v, s
    spring_kick: PerMode  # t·ω², 1/s: momentum per displacement in half a kick
    weight_kick: PerMode  # t·weight, √kg·m/s: momentum in half a kick
    loss: ModalLoss  # at either end of the step
    drag: ModalLoss  # in the drift (engine.assembly.mode_coefficients.loses_in_drift)
    connection: ConnectionCoefficients
    contact: ContactCoefficients
    force: RowCoefficients  # of ExternalForce.rows


class StepSettings(NamedTuple):
    """Coefficients, kind and time of a step."""

    h: Any  # StepCoefficients
    kind: int  # StepKind
    is_free: bool  # True if neither contacts nor external forces can act
    frame: int
    span: Any  # begin and end of the step, frames after this one


class FreeMasses(NamedTuple):
    """Modes without a restoring force."""

    mode: PerFreeMassInt
    is_audible: PerIslandBool  # whether a pickup hears one of them


class ExternalForce(NamedTuple):
    """External forces; each a table of its mean over each step (paper, eq. 34)."""

    rows: Annotated[ModeShapeRows, Axis.FORCE]  # where each acts
    start: PerForceInt  # first step of its table
    table_begin: PerForceInt  # its slice of `table`
    table_end: PerForceInt
    table: Shared  # N
    tail: PerForce  # N, for steps past its table
    drive: Annotated[np.ndarray, Items(Axis.FORCE, np.int64, neutral=-1)]  # or the point that strings drive, or -1


class Drive(NamedTuple):
    """Points of bodies that ends of strings drive: pickups write their forces, and external forces read them."""

    island: PerDriveInt  # of the body that is driven


class Connections(NamedTuple):
    """Connections: springs, dampers and rigid joints between points of bodies, or a point and the ground, and ends of
    strings that move. Each has a coordinate: the extension of a spring; or of an end two, the displacement of the end,
    and the force of the strings that end there."""

    rows: Annotated[ModeShapeRows, Axis.CONNECTION_PART]  # what each body has in them, in the order of its modes
    coordinate: PerConnectionPartInt  # that each part belongs to
    coupling: PerConnectionPair  # N/m: the stiffness that the coordinates of string ends have in common
    is_rigid: PerConnectionInt  # 1 or 0
    is_unconnected: PerModeFactor  # 0 for modes of bodies that are connected
    is_plain: PerIslandInt  # 1 if the modes of the island have neither weight nor loss in the drift
    contact_reach: PerContact  # m/√J: how far a contact can close in a flight, per √(2E) of what is connected
    contact_reach_by_forces: PerContact  # m/√J: and how much further than its bodies by themselves


class Stiffening(NamedTuple):
    """Pairs of points on bodies that stretch, which these move less where their tension rises
    (engine.kernel.interactions.stretched_compliance)."""

    pairs: Annotated[np.ndarray, Items(Axis.PAIR_ON_BODY, np.int64, len(PairOnBody))]
    begin: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, len(StiffenedMatrix) + 1)]  # of those in each matrix
    shapes: PerShape  # Φ, 1/√kg


class Tension(NamedTuple):
    """Bodies whose tension rises as they stretch (engine.kernel.interactions.tension), by body."""

    mode_begin: Annotated[np.ndarray, Items(Axis.BODY, np.int64)]  # its modes; none of a body that does not stretch
    mode_end: Annotated[np.ndarray, Items(Axis.BODY, np.int64)]
    kappa: PerMode  # κ: the stretch is Σ κ·q², in m of strings, in m² of sheets
    ends: Annotated[np.ndarray, Items(Axis.BODY, np.int64, len(MovingEnd), neutral=-1)]
    factor: Annotated[np.ndarray, Items(Axis.BODY, columns=len(StretchFactor))]
    stiffening: Stiffening
    can_stretch: PerIslandInt  # 1 if a body of the island does
    heard: Annotated[np.ndarray, Items(Axis.PICKUP, np.int64, neutral=-1)]  # body whose rise a pickup hears, or -1
    heard_share: PerPickup  # of the rise itself: 1 or 0
    pull: Annotated[ModeShapeRows, Axis.PICKUP]  # force of a string on its end that a pickup hears, per N of the rise


class Friction(NamedTuple):
    """Points of friction, which lie among the contacts (engine.kernel.contact.friction_points)."""

    pressed_by: Annotated[np.ndarray, Items(Axis.CONTACT, np.int64, neutral=-1)]  # contact that presses, or -1
    is_present: PerIslandInt  # 1 if the island has some
    is_apart: PerIslandInt  # 1 if contacts press some, which move none of these contacts


class Contact(NamedTuple):
    """Contacts and points of friction: where each is on the bodies that it joins. Its law is in the State."""

    rows: Annotated[ModeShapeRows, Axis.CONTACT]  # of the body that touches
    other_rows: Annotated[ModeShapeRows, Axis.CONTACT]  # of the body it touches, empty for a barrier
    friction: Friction
    has_power_laws: Annotated[
        np.ndarray, Items(Axis.ISLAND, np.int64, neutral=1)
    ]  # 1 if contacts of the island have no other
    nominal_stiffness: PerContact  # N/m^α, as the patch says
    nominal_barrier: PerContact  # m, as the patch says; subtracted from the projected displacement
    tolerance: float  # relative error left in the end compression
    max_rounds: int  # of a coupled solve; then it ends with forces off their curves


class ContactLoss(NamedTuple):
    """Contact loss between the stages of a sample (engine.kernel.interactions.contact_loss)."""

    loss: PerContact  # μ, s/m
    mobility: PerContact  # W = Φ·Φᵀ, 1/kg
    saturation: PerContact  # 1/N: times the elastic force, 1 where the loss is too strong to act there


class AdaptiveSteps(NamedTuple):
    """Limits to steps that are chosen by error (engine.kernel.run.adaptive_steps)."""

    finest: int  # level of the most: steps are doubled so often
    limit: float  # what twice the steps may change the motion in a sample, relative to the largest motion


class ForceShapes(NamedTuple):
    """External forces as functions of time, for stages of a sample (engine.kernel.interactions.force_shapes)."""

    kind: PerForceInt  # ForceKind
    number: Annotated[np.ndarray, Items(Axis.FORCE, columns=len(ForceNumber))]
    envelope_begin: PerForceInt  # its slice of the envelope's points; empty without one
    envelope_end: PerForceInt
    envelope_time: Shared  # frames after the start
    envelope_factor: Shared
    line_begin: PerForceInt  # where `line` has the value at the first step of the force's table, of LINES
    line: Shared  # N, at each frame


class Refinement(NamedTuple):
    """A sample in stages (engine.kernel.run.refinement). Stages of one length, with the same loss, are of one kind."""

    stages: StepCoefficients  # one row for each kind; with AdaptiveSteps, for each of each level
    contact_loss: ContactLoss  # None where it is in the solve, or there is none
    sequence: SharedInt  # the kind of each stage of a step
    sequence_in_solve: SharedInt  # of order 2, where contact loss is too strong to act between stages
    loss_before: Shared  # s: how long contacts and dampers lose before each stage, if they do not in the stages
    loss_after: Shared  # and after it
    damper_share: Shared  # of a sample, for which dampers of events act at either end of a finest step; and within it
    force: ForceShapes  # of the external forces
    length: Shared  # of each kind, as a share of a sample
    steps: int  # of a sample; with AdaptiveSteps, of the coarsest level
    kinds: int  # of stages, of a level
    adaptive: AdaptiveSteps
    refine_free_flight: bool  # also out of contact
    chord_deviation: PerMode  # how far a mode strays from its chord within a sample, per amplitude
    gravity_deviation: PerMode  # √kg·m: and how far by its weight


class FreeMotion(NamedTuple):
    """Motion of modes on which nothing acts, over several samples: q ← qq·q + qp·p, p ← pq·q + pp·p."""

    qq: PerModeFactor
    qp: PerMode  # s
    pq: PerMode  # 1/s
    pp: PerModeFactor


class FreeMotionResidue(NamedTuple):
    """Parts that rounding cut from a FreeMotion."""

    qq: PerMode
    qp: PerMode
    pq: PerMode
    pp: PerMode


class FlightLoss(NamedTuple):
    """Energy lost over a flight that begins with q and p: qq·q² + qp·q·p + pp·p², J."""

    qq: PerMode
    qp: PerMode
    pp: PerMode


class FlightWeight(NamedTuple):
    """Effect of weight over a flight."""

    q: PerMode  # √kg·m, added to the displacement
    p: PerMode  # √kg·m/s, added to the momentum
    p_low: PerMode  # what rounding cut from it
    lost_per_q: PerMode  # energy lost, beside FlightLoss
    lost_per_p: PerMode
    lost: PerMode  # J
    pickup_values: Annotated[np.ndarray, Items(Axis.PICKUP, columns=FLIGHT_FRAMES)]  # what pickups give in each sample


class FreeFlight(NamedTuple):
    """FLIGHT_FRAMES samples at once (engine.kernel.modes.free_flight): powers of the map that is one step."""

    motion: FreeMotion  # over a flight
    motion_low: FreeMotionResidue
    part: FreeMotion  # over FLIGHT_PART samples
    bound_per_speed: PerMode  # s: how far a mode can move in a flight, per speed
    bound_per_weight: PerMode  # s²: and per weight, if it is a free mass
    loss: FlightLoss
    weight: FlightWeight
    # what a mode gives at a pickup in each of FLIGHT_PART samples, per displacement and then per momentum at the first;
    # counted as Pickups.rows.phi
    pickup_tables: Annotated[np.ndarray, Items(Axis.SHAPE, columns=2 * FLIGHT_PART)]


class Events(NamedTuple):
    """The score, sorted by island and start (engine.kernel.run.events)."""

    kind: PerEventInt  # EventKind
    start: PerEventInt  # the step it begins with
    end: PerEventInt  # the step after its last
    target_begin: PerEventInt  # the modes or contacts it acts on
    target_end: PerEventInt
    value: PerEvent
    value2: PerEvent
    value3: PerEvent


class Pickups(NamedTuple):
    """Pickups, and the channels that they feed."""

    rows: Annotated[ModeShapeRows, Axis.PICKUP]
    quantity: PerPickupInt  # Quantity
    channel: PerPickupInt  # from 0; -1 - n: it drives point n instead of being heard
    gain: PerPickup
    contact_begin: PerPickupInt  # its slice of `contact` and `contact_sign`, where it hears contact forces
    contact_end: PerPickupInt
    contact: SharedInt
    contact_sign: Shared


class Islands(NamedTuple):
    """Begin of the items of each island, by axis: [islands + 1] each.

    `partition` cuts the islands in partitions, each of which may run on a core of its own: [partitions + 1].
    """

    mode: np.ndarray
    contact: np.ndarray
    compliance: np.ndarray
    connection: np.ndarray
    connection_pair: np.ndarray
    connection_contact: np.ndarray
    connection_part: np.ndarray
    pair_on_body: np.ndarray
    force: np.ndarray
    event: np.ndarray
    pickup: np.ndarray
    body: np.ndarray
    free_mass: np.ndarray
    heavy_mode: np.ndarray
    partition: np.ndarray


class Model(NamedTuple):
    """Everything that stays."""

    samplerate: float
    effects: int  # bits
    islands: Islands  # of the whole scene; None in the model of one island
    step: StepCoefficients  # of a sample as one step
    omega_squared: PerMode  # 1/s²: restoring force
    weight: PerMode  # √kg·m/s²: gravity
    force: ExternalForce
    drive: Drive
    connection: Connections
    contact: Contact
    tension: Tension
    refinement: Refinement | None
    events: Events
    pickups: Pickups
    flight: FreeFlight
    bodies: Annotated[ModeShapeRows, Axis.BODY]  # where each body is traced
    free_masses: FreeMasses
    sleep_threshold: float  # share of its peak below which an island sleeps (engine.kernel.run.sleep)
