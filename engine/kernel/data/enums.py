"""Meanings of whole numbers in the kernels: statuses, kinds and the columns of arrays.

Compiled code has their values as constants. Numbers of event kinds never change, because logs of live sound hold them.
"""

from enum import IntEnum


class Quantity(IntEnum):
    """Quantity that a pickup gives."""

    DISPLACEMENT = 0
    VELOCITY = 1
    ACCELERATION = 2
    FORCE = 3  # of contacts, or by which a tension rises: it does not follow from the motion linearly


class SolveStatus(IntEnum):
    """Outcome of a contact solve; also the column of its counter in State.solve_outcomes."""

    FREE = 0  # no contact in reach
    SEPARATION = 1  # in closed form: the step ends outside contact
    CLOSED_FORM = 2
    NEWTON = 3
    FAILED = 4
    CAPPED = 5  # ended early, with forces off their curves
    # of steps, beside contact solves
    LOOSE_TENSION = 6  # a tension was taken with more than rounding left
    REVERSED = 7  # forces were not found, or not finite: the motion was reversed


class EventKind(IntEnum):
    """Kind of an event: its action, and its target."""

    STRIKE = 0  # the target mode gets q = value, p = value2
    DAMP = 1  # the target modes keep `value` of their energy of motion in each step, half of the loss at either end
    STIFFNESS = 2  # the stiffness of the target contacts glides to `value` times what the model says
    BARRIER = 3  # the barriers of the target contacts glide to `value` beyond where the model has them
    EXPONENT = 4  # the exponents of the target contacts glide to `value`
    LIFT = 5  # what damps the target modes ends; if `value` is not 0, what was to damp them for good does not begin
    LAUNCH_AND_LIFT = (
        6  # as STRIKE, and what damps the bodies that the target mode has contacts with is lifted, as by a key
    )
    PLUCK = 7  # at the target force's point: ½(1 - cos) up to `value` N in `value2` samples, down in `value3`
    # those of live sound
    FORCE_AGAIN = 8  # the table of the target force acts again, `value` times as strong
    DROP_QUIETEST = 9  # so many islands fade out and are at rest, the quietest that sound
    QUALITY = 10  # play at a level of quality
    EXCHANGE_TABLES = 11  # some islands get other coefficients
    BOOK_ENERGY = 12  # the energy of an island counts as supplied, or as taken
    GROUP = 24  # a table of events, which begin together
    CANCEL = 23  # the events of a note that have not begun are forgotten
    # of connections
    CONNECTION_STIFFNESS = 13  # the stiffness of the target coordinates glides to `value`
    CONNECTION_DAMPING = 14
    CONNECTION_REST = 15
    # of friction: a number of the target points glides to `value`; in the order of Sliding
    FRICTION_VELOCITY = 16
    FRICTION_FORCE = 17
    FRICTION_STATIC = 18
    FRICTION_DYNAMIC = 19
    FRICTION_SPEED = 20
    FRICTION_MEMORY = 21
    FRICTION_BRISTLE = 22


PUSHING_EVENTS = EventKind.PLUCK, EventKind.FORCE_AGAIN
FRICTION_EVENTS = tuple(kind for kind in EventKind if kind.name.startswith("FRICTION_"))  # in the order of Sliding


class EventCursor(IntEnum):
    """Columns of State.event_cursor."""

    FIRST_ACTIVE = 0  # the first event that is not over
    NEXT = 1  # the first that has not begun
    DAMPED = 2  # a column of DampedModes
    PUSHING = 3  # how many that have begun push: plucks, and forces that act again
    GLIDING = 4  # and how many glide


class DampedModes(IntEnum):
    """Number of modes that events damp: unknown, none or some."""

    UNKNOWN = 0  # what they leave has to be found anew
    NONE = 1
    SOME = 2


class Ledger(IntEnum):
    """Rows of a ledger, J."""

    BALANCE = 0  # stored + dissipated - supplied
    ABSOLUTE = 1  # all parts of the stored energy without their signs


class Balance(IntEnum):
    """Statistics of the energy balance of a scene, J."""

    SAMPLES = 0  # followed so far
    INITIAL = 1
    LAST = 2
    LARGEST = 3  # energy held, all parts without their signs
    MAX_ERROR = 4  # against the initial balance; infinite where one is no number
    MAX_ERROR_PER_STEP = 5


class Stretch(IntEnum):
    """Columns of TensionState.body."""

    RISE = 0  # λ of the present step: N of strings, N/m of sheets
    LAST = 1  # of the step before, and of two more
    SECOND_LAST = 2
    THIRD_LAST = 3
    TRIED = 4  # a rise that was tried, and that which it led to less it
    TRIED_RESIDUAL = 5
    LOW = 6  # between these is the rise, from the signs of residuals
    HIGH = 7
    ENDS_BEFORE = 8  # what moving ends stretch it, m: at the begin of the step, and at its end
    ENDS_AFTER = 9
    STRETCHES = 10  # 1, or 0 while the body is taken for linear
    RESIDUAL = 11  # that which the rise of this round leads to less it; 0 if it is found


class StiffenedMatrix(IntEnum):
    """Matrices of the points of an island that a rise of tension changes."""

    CONTACTS = 0  # how far contacts move each other
    CONTACT_MOVES = 1  # how far contacts move coordinates of connections
    CONNECTIONS = 2  # and these each other


class PairOnBody(IntEnum):
    """Columns of Stiffening.pairs: two points on a body that stretches."""

    BODY = 0
    MODE_BEGIN = 1  # of its modes, and their number
    MODES = 2
    SHAPE = 3  # where Stiffening.shapes has those of the first point, and of the second
    OTHER_SHAPE = 4
    TARGET = 5  # what a force at one moves the other, in its matrix
    MIRROR = 6  # the same once more, or -1


class Sliding(IntEnum):
    """Columns of State.law_numbers of a point of friction. Events change the first seven."""

    VELOCITY = 0  # m/s, of the surface that moves by itself
    FORCE = 1  # N, that presses the surfaces together, if no contact does
    STATIC = 2  # coefficients of friction, at rest and in fast slip
    DYNAMIC = 3
    SPEED = 4  # m/s: slip at which the coefficient is half-way
    MEMORY = 5  # s
    BRISTLE = 6  # N/m; 0 of a contact
    PRESS = 7  # N: what presses in the present step
    COEFFICIENT = 8  # of friction in it
    BOUND = 9  # N: the largest force of friction in it
    SLOPE = 10  # N/m, of the force by the slip in it, while the surfaces stick
    SLIP = 11  # m/s: how fast the surfaces slip, beyond what the bristle bends
    REMEMBERED_SPEED = 12  # m/s, of slip
    DAMPING_TIME = 13  # s: damping of the bristle, as a share of its stiffness
    VISCOUS = 14  # s/m: how the coefficient rises with the speed of slip
    IS_EXPONENTIAL = 15  # 1 if the coefficient falls as an exponential, 0 if as a hyperbola
    IS_CHOSEN = 16  # 1 once the coefficient of the present step was chosen by its slip


class MovingEnd(IntEnum):
    """Columns of Tension.ends: of each of two ends of a string that move, the coordinates of its slope and of its
    displacement, or -1."""

    SLOPE = 0
    DISPLACEMENT = 1
    OTHER_SLOPE = 2
    OTHER_DISPLACEMENT = 3


class StretchFactor(IntEnum):
    """Columns of Tension.factor."""

    STIFFNESS = 0  # K: N/m of strings, N/m³ of sheets; 0 of a body that does not stretch
    SOFTEST = 1  # κ/ω² at most, 1/N or m/N
    UNHEARD = 2  # of stiffness times energy: what is less raises no partial by more than is allowed
    END = 3  # 1/m: what ends stretch a string per square of their displacement, and per product of both
    OTHER_END = 4
    BOTH_ENDS = 5


class ForceKind(IntEnum):
    """Shape of an external force in time."""

    TABLE = 0  # only its mean over each sample is known
    LEVEL = 1  # a constant from its start on, or a pulse
    HALF_SINE = 2
    SINE = 3
    PLUCK = 4
    LINES = 5  # straight from one frame to the next


class ForceNumber(IntEnum):
    """Columns of ForceShapes.number; times in frames."""

    START = 0
    DURATION = 1  # infinite of a constant; of a pluck, its rise
    AMPLITUDE = 2  # N
    FREQUENCY = 3  # of a sine: periods per frame
    PHASE = 4  # and periods at its start
    FADE = 5  # at either end; of a pluck, its fall


class EnergyTotal(IntEnum):
    """Columns of State.energy_totals, J. Each sum is followed by the rounding that it carries."""

    DISSIPATED = 0
    DISSIPATED_LOW = 1
    SUPPLIED = 2
    SUPPLIED_LOW = 3


class SleepMonitor(IntEnum):
    """Columns of State.sleep_monitor: past levels of an island, which tell when it may sleep."""

    PEAK = 0  # of its pickups, since the last check
    PEAK_EVER = 1
    ENERGY_EVER = 2  # the largest energy of vibration, J


class Sleep(IntEnum):
    """Columns of State.sleep, in frames."""

    WAKE_FRAME = 0
    STATIC_UNTIL = 1  # before this frame, nothing in the island moves
    SAMPLES_SLEPT = 2
    FADE_END = 3  # frame at which an island has faded out; negative: at which it has risen again; 0: neither


class StepKind(IntEnum):
    """Length of a step: that of State.drift_kind. Stages of kind s are FIRST_STAGE + s."""

    UNKNOWN = 0
    SAMPLE = 1  # a whole sample
    FIRST_STAGE = 2


class Wanted(IntEnum):
    """Outputs of a block that may be wanted beside its audio: items of BlockOutput.wanted."""

    ENERGIES = 0  # its ledger; a value of Energies
    MOTION = 1  # its trace


class Energies(IntEnum):
    """Samples at which energies are measured."""

    NEVER = 0
    AT_EACH_SAMPLE = 1
    AT_CHECKS = 2  # every FLIGHT_FRAMES samples: an error stays in the balance, so that it is found at the next check


class FlightFrame(IntEnum):
    """Columns of FreeFlightState.frame."""

    END = 0  # the flight that was planned last ends before this frame
    SAVED = 1  # the saved motion is that at this frame


class Row(IntEnum):
    """Rows of Scratch.vectors: data of the coupled contact solver for each contact …"""

    FORCE = 0
    STEP = 1  # η
    END = 2  # end compression
    STEP_RESIDUAL = 3  # what the bodies move beyond the step
    END_FORCE = 19  # elastic, at the end compression; of contacts that persist
    # … and of each in the active set
    START = 4  # compression
    FREE_MOVE = 5  # g
    GUESS = 6  # force
    TARGET = 7  # of η + ρ·f
    RHO = 8
    ACTIVE_FORCE = 9
    ACTIVE_STEP = 10
    ACTIVE_END = 11
    SLOPE = 12
    RESIDUAL = 13
    NEWTON_STEP = 14
    FURTHER_MOVE = 15  # with the Newton step
    SQRT_SLOPE = 16
    WORK = 17
    START_POWER = 18  # s^α


LAW_NUMBERS = 24  # numbers that a law may have of each contact
LANES = 8  # numbers that are taken at once
BALANCE_MEMORY = 8  # of a Balance: eight numbers, where its others end
BALANCE_SIZE = BALANCE_MEMORY + LANES
MAX_ROUNDS = 200  # of a contact solve, or evaluations of a contact law
FURTHER_ROUNDS = 64  # beyond their caps, which the solves of an island may take between two periodic checks
LINE_SEARCHES = 16  # that its capped solves may take in that time

CHUNK_FRAMES = 1024  # samples an island runs before the next one does: few enough for the fast cache
DRIVE_FRAMES = 2 * CHUNK_FRAMES  # samples that are kept of the forces of strings that drive bodies; a power of 2
FLIGHT_FRAMES = 64  # samples of a free flight (engine.kernel.modes.free_flight), and between two periodic checks
FLIGHT_PART = 8  # samples of it that one table gives
FLIGHT_MODES = 128  # modes that are taken through a flight together: few enough for the fast cache

NO_END = 1 << 60  # when an event ends that stays for good
UNUSED_SLOT = 1 << 61  # when an event begins that has not come yet: capacity for those of live sound
