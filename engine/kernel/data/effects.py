"""Effects that a kernel is compiled with: one constant of bits.

The general kernel has all effects, and runs any scene: what a scene lacks are arrays without items, or of numbers that
do nothing. A special kernel has the effects of one scene: what stands behind another bit is not compiled, as Numba
drops `if EFFECTS & FRICTION:` before it looks at what is in it. The constant is frozen in all that a process compiles,
so that each set of effects is compiled in a process of its own (engine.compiler.special_kernels).
"""

from engine.compiler.special_kernels import EFFECTS as EFFECTS

SPRINGS = 1 << 0  # modes with a restoring force
WEIGHT = 1 << 1  # gravity
LOSS = 1 << 2  # at either end of a step
DRAG = 1 << 3  # in its drift
CONTACTS = 1 << 4  # points of friction among them
TWO_BODIES = 1 << 5  # contacts between bodies
SEVERAL = 1 << 6  # contacts in one island
CONTACT_LOSS = 1 << 7
FRICTION = 1 << 8
CONNECTIONS = 1 << 9
STRETCHING = 1 << 10
FORCES = 1 << 11  # external ones
DRIVE = 1 << 12  # of bodies by ends of strings
EVENTS = 1 << 13
RELAXATION = 1 << 14  # felt with memory

# as statistics name them; stages of a sample are no bit, but a type: a scene with them has another Model
EFFECT_NAMES = {
    "loss": LOSS,
    "loss within the step": DRAG,
    "restoring force": SPRINGS,
    "gravity": WEIGHT,
    "external force": FORCES,
    "one-way drive": DRIVE,
    "contact": CONTACTS,
    "contact between bodies": TWO_BODIES,
    "contact loss": CONTACT_LOSS,
    "coupled contacts": SEVERAL,
    "friction": FRICTION,
    "felt with memory": RELAXATION,
    "connections": CONNECTIONS,
    "stretching": STRETCHING,
    "events": EVENTS,
}
