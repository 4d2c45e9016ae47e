"""The `State`: everything that changes while a scene sounds; and the arrays that a block of samples fills."""

from typing import Annotated, NamedTuple

import numpy as np

from engine.kernel.data.axes import (
    Axis,
    Items,
    PerCompliance,
    PerConnection,
    PerConnectionContact,
    PerConnectionPair,
    PerConnectionPart,
    PerContact,
    PerContactInt,
    PerEvent,
    PerForce,
    PerHeavyMode,
    PerIsland,
    PerIslandInt,
    PerMode,
    PerPickup,
)
from engine.kernel.data.enums import (
    DRIVE_FRAMES,
    FLIGHT_FRAMES,
    FLIGHT_MODES,
    FLIGHT_PART,
    LAW_NUMBERS,
    MAX_ROUNDS,
    EnergyTotal,
    EventCursor,
    FlightFrame,
    Ledger,
    Sleep,
    SleepMonitor,
    SolveStatus,
    Stretch,
)

PerLaw = Annotated[np.ndarray, Items(Axis.CONTACT, columns=LAW_NUMBERS)]
PerPartition = Annotated[np.ndarray, Items(Axis.PARTITION)]
PerPartitionInt = Annotated[np.ndarray, Items(Axis.PARTITION, np.int64)]


class Scratch(NamedTuple):
    """Memory for the coupled contact solve of each partition. K is the largest number of contacts in an island. L is at
    least as large, and a multiple of eight."""

    vectors: PerPartition  # [partitions, rows (engine.kernel.data.enums.Row), L]
    active_compliance: PerPartition  # [partitions, K, L]: B of the active set
    cholesky: PerPartition  # [partitions, K, L]: what is factorised
    active: PerPartitionInt  # [partitions, K]: the contacts of the active set
    is_active: PerPartitionInt  # [partitions, K]: whether a contact is in the active set


class NearContacts(NamedTuple):
    """Contacts of an island with connections that may close soon (engine.kernel.interactions.near_contacts). The last
    seven fields hold what a solve of these contacts needs, one after the other, at their front."""

    until: PerIslandInt  # before this frame, no other contact can close
    size: PerIslandInt  # how many they are
    is_far: PerContactInt  # 1 for the others, whose compressions are not kept
    contact: PerContactInt  # their numbers
    compression: PerContact  # m
    free_displacement: PerContact  # m
    potential_coefficient: PerContact  # N/m^α
    exponent: PerContact
    loss_rate: PerContact  # 1/m
    coupling: PerCompliance  # B, m/N
    moves: PerConnectionContact  # m/N, of all connections, a row for each


class ConnectionState(NamedTuple):
    """State of connections, by coordinate."""

    stiffness: PerConnection  # N/m; events change it, and the next two
    damping: PerConnection  # kg/s
    rest: PerConnection  # m
    extension: PerConnection  # s, m
    extension_compensation: PerConnection  # m: what is too small to add to it yet (Kahan)
    force: PerConnection  # f, N, constant over the step
    force_on_row: PerConnectionPart  # N: what it does at each row of a body with many
    free_move: PerConnection  # g, m: how the coming drift changes the extension without the force
    move: PerConnection  # m: how it does with it
    lowest_energy: PerIsland  # J: of all that is connected, at rest; minus infinity where that is not known
    is_move_known: PerIslandInt  # 1 if `free_move` is that of the coming drift
    matrix: PerConnectionPair  # memory to make factors
    near: NearContacts


class StiffenedConnections(NamedTuple):
    """Coefficients of connections of stretched bodies (engine.kernel.data.model.ConnectionCoefficients)."""

    compliance: PerConnectionPair
    force_per_extension: PerConnectionPair
    force_per_move: PerConnectionPair
    coupling: PerConnectionPair  # that of Connections, and what tensions add
    contact_moves: PerConnectionContact
    contact_compliance: PerCompliance


class TensionState(NamedTuple):
    """State of bodies that stretch (engine.kernel.interactions.tension); and memory for steps with contacts and
    connections."""

    body: Annotated[np.ndarray, Items(Axis.BODY, columns=len(Stretch))]
    is_active: PerIslandInt  # 0 while the bodies of the island are taken for linear
    push_per_rise: PerMode  # memory: of the tension of a step, √kg·m/s per N
    decline_per_rise: PerMode  # memory, 1/N
    momentum: PerMode  # √kg·m/s: of the drift by neither contacts nor tension
    push: PerMode  # √kg·m/s: what external forces give in half a kick
    compliance: PerContact  # B_kk of stretched bodies, m/N
    compliance_low: PerContact
    coupling: PerCompliance  # B, m/N
    connection: StiffenedConnections


class SavedMotion(NamedTuple):
    """State of an island at the start of a sample, to try the sample with another number of steps
    (engine.kernel.run.adaptive_steps)."""

    q: PerMode
    p: PerMode
    kick_compensation: PerHeavyMode
    compression: PerContact
    compression_compensation: PerContact
    contact_force: PerContact
    law_numbers: PerLaw
    extension: PerConnection
    extension_compensation: PerConnection
    energy_totals: Annotated[np.ndarray, Items(Axis.ISLAND, columns=len(EnergyTotal))]
    energy_debt: PerIsland
    samples_of_strong_loss: PerIslandInt


class RefinementState(NamedTuple):
    """State of refined samples (engine.kernel.run.refinement)."""

    level: PerIslandInt  # of the present sample: its steps are doubled so often
    next_level: PerIslandInt  # of the next one, to begin with
    tries: PerIslandInt  # of the present sample, so far
    largest_motion: PerIsland  # √J: √Σ(p² + ω²q²) so far
    largest_error: PerIsland  # of what twice the steps changed in a sample, relative to the largest motion
    capped_samples: PerIslandInt  # that would have needed more steps
    saved: SavedMotion
    coarse_q: PerMode  # after the try before
    coarse_p: PerMode

    closing_margin: PerContact  # m: how far a compression may stray within a sample
    margin_valid: PerIslandInt  # whether the margins still hold
    mean_force: PerContact  # N, over the stages so far
    loss_impulse: PerContact  # N·s, of contact loss between the stages so far
    samples_of_strong_loss: PerIslandInt  # in which contact loss was too strong to act between stages
    damped_at_ends: PerMode  # what dampers of events leave of each momentum at either end of a finest step
    damped_inside: PerMode  # after its first stage, and before its last


class FreeFlightState(NamedTuple):
    """Data of a free flight that are kept until it is over."""

    frame: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, len(FlightFrame))]
    q: PerMode  # √kg·m, the saved motion: that at the begin of the flight, or since taken on by single steps
    p: PerMode  # √kg·m/s
    kick_compensation: PerHeavyMode
    energy_totals: Annotated[np.ndarray, Items(Axis.ISLAND, columns=len(EnergyTotal))]  # J
    ledger: Annotated[np.ndarray, Items(Axis.ISLAND, columns=len(Ledger))]  # J, at the begin of a flight or of sleep
    pickup_values: Annotated[np.ndarray, Items(Axis.PICKUP, columns=FLIGHT_FRAMES)]  # m or m/s, at each pickup
    # memory: modes at every FLIGHT_PART-th sample, their displacements and then their momenta
    parts: Annotated[np.ndarray, Items(Axis.PARTITION, columns=2 * FLIGHT_FRAMES // FLIGHT_PART * FLIGHT_MODES)]


class State(NamedTuple):
    """Everything that changes.

    While an island flies free (`flight`), its motion is already that at the end of the flight.
    """

    frame: PerPartitionInt  # samples rendered so far
    q: PerMode  # √kg·m, displacement
    p: PerMode  # √kg·m/s, momentum
    kick_compensation: PerHeavyMode  # rounding carried from kick to kick, of weights (Kahan)
    push: PerMode  # √kg·m/s: what forces give each mode in half a kick; 0 between steps
    drift_momentum: PerMode  # √kg·m/s: of the coming drift, by all but the forces of its step
    drift_loss: PerIsland  # J: what modes lose before the coming drift
    drift_kind: PerIslandInt  # StepKind of the step that both are known for
    displacement_bound: PerMode  # √kg·m: memory to bound how far each mode can move
    potential_coefficient: PerContact  # k/(α+1), N/m^α: stiffness as contact laws count it; events change it
    exponent: PerContact  # events change that of a general law
    barrier: PerContact  # m; events move it
    compression: PerContact  # m; of friction, how far the bristle is bent
    compression_compensation: PerContact  # m: what is too small to add to the compression yet (Kahan)
    free_displacement: PerContact  # m: g, the change of compression without contact force
    contact_force: PerContact  # N, mean over the last step
    external_force: PerForce  # N, mean over the present step
    law_numbers: PerLaw  # of contacts whose law has more than coefficient and exponent, such as points of friction
    drive: Annotated[np.ndarray, Items(Axis.DRIVE, columns=DRIVE_FRAMES)]  # N, at each frame modulo their number
    connection: ConnectionState
    tension: TensionState
    scratch: Scratch  # for coupled contacts
    refinement: RefinementState | None
    flight: FreeFlightState
    solve_budget: PerIslandInt  # further rounds and line searches left to coupled solves
    energy_debt: PerIsland  # J: what capped solves created and the motion could not pay for yet
    previous_velocity: PerPickup  # m/s, one sample ago
    energy_totals: Annotated[np.ndarray, Items(Axis.ISLAND, columns=len(EnergyTotal))]  # J
    contact_free_until: PerIslandInt  # before this frame, nothing can act on the island
    event_cursor: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, len(EventCursor))]
    damped_decay_factor: PerMode  # those of StepCoefficients.loss, with the dampers of events
    damped_dissipation_factor: PerMode
    glide_start: PerEvent  # what a gliding value was at first
    sleep_monitor: Annotated[np.ndarray, Items(Axis.ISLAND, columns=len(SleepMonitor))]
    sleep: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, len(Sleep))]
    in_contact: PerIslandInt  # 1 if the last step had a contact in reach
    law_evaluations: PerIslandInt  # in the last step
    iteration_histogram: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, MAX_ROUNDS + 1)]  # of Newton solves
    solve_outcomes: Annotated[np.ndarray, Items(Axis.ISLAND, np.int64, len(SolveStatus))]  # counts
    contact_samples: PerIslandInt  # samples with a contact in reach


class Trace(NamedTuple):
    """Motion, forces and energies at every sample; arrays of [frames, …] that a block fills.

    `force` is the mean over the step that ends at the sample, so it is 0 at sample 0; `iterations` are those of that
    step.
    """

    displacement: np.ndarray  # [frames, bodies], m
    velocity: np.ndarray  # [frames, bodies], m/s
    compression: np.ndarray  # [frames, contacts], m
    force: np.ndarray  # [frames, contacts], N
    iterations: np.ndarray  # [frames]
    kinetic: np.ndarray  # [frames], J
    potential: np.ndarray
    contact: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray


class BlockOutput(NamedTuple):
    """Arrays that a block of one partition fills."""

    audio: np.ndarray  # [frames, channels], overwritten
    ledger: np.ndarray  # [rows (engine.kernel.data.enums.Ledger), frames], J, overwritten where energies are wanted
    trace: Trace  # [frames, …], zeroed, to be added to, where motion is wanted
    wanted: np.ndarray  # [engine.kernel.data.enums.Wanted], 0 or 1: what is not is of any size
