"""Prints a digest of the modes of bodies of many kinds: frequencies, and shapes at twenty places.

The first word of each line names the body. "LAPACK" stands for eigenvectors as they come from there, and "libm" for
functions of NumPy: these may depend on the processor.
"""

import hashlib
import math
import sys

import numpy as np

from engine.bodies.cylinder_modes import Shell, cylinder_modes
from engine.bodies.plate_modes import PlateModes, PlateStiffness, Rib, rectangle_plate_modes

STEPS = np.arange(1, 21)[:, None] * np.array([0.6180339887, 0.7548776662])
PLACES = STEPS - np.floor(STEPS)
METAL, WOOD = PlateStiffness.isotropic(50.0, 0.3), PlateStiffness(300.0, 25.0, 8.0, 12.0)
RIBS = [Rib("y", at, 60.0, 0.05) for at in (1 / 6, 1 / 2, 5 / 6)]
BRIDGE = [Rib("x", 0.35, 80.0, 0.2)]
DRUM = Shell(0.178, 0.14, 6e-3, 1e10, 0.3, 600.0)


def find_modes(name: str) -> PlateModes:
    """The modes of one body."""
    side = (0.5, 0.3)
    if name == "free plate":
        return rectangle_plate_modes(side, METAL, 3.0, edges="free", count=40)
    if name == "square plate":
        return rectangle_plate_modes((0.4, 0.4), METAL, 3.0, edges="clamped", count=80)
    if name == "plate below a frequency":
        return rectangle_plate_modes(side, METAL, 3.0, edges="free", count=400, max_omega=2 * math.pi * 1500)
    if name == "plate with four edges":
        edges = ("free", "supported", "clamped", "free")
        return rectangle_plate_modes(side, METAL, 3.0, 200.0, edges, count=30)
    if name == "hinged plate":
        return rectangle_plate_modes(side, METAL, 3.0, 0.0, ("supported", "free", "free", "free"), count=20)
    if name == "supported plate":
        return rectangle_plate_modes(side, WOOD, 3.0, 100.0, count=60)
    if name == "soundboard":
        return rectangle_plate_modes(side, WOOD, 1.2, edges="clamped", ribs=[*RIBS, *BRIDGE], count=40)
    if name == "supported soundboard":
        return rectangle_plate_modes(side, WOOD, 1.2, ribs=RIBS, count=40)
    if name == "free ribbed plate":
        return rectangle_plate_modes(side, WOOD, 1.2, edges="free", ribs=BRIDGE, count=20)
    return cylinder_modes(DRUM, name.split()[0], count=20)  # type: ignore[arg-type]


BODIES = [
    "free plate",
    "square plate",
    "plate below a frequency",
    "plate with four edges",
    "hinged plate",
    "supported plate",
    "soundboard",
    "supported soundboard",
    "free ribbed plate",
    "free shell",
    "supported shell",
    "clamped shell",
]


def digest(*arrays: np.ndarray) -> str:
    """A digest of their bits."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()[:16]


def main() -> None:
    """Print the digests of the bodies that are named, or of all."""
    numbers = np.sin(np.arange(1.0, 40_001).reshape(200, 200) ** 2 % 7.0)
    print("LAPACK", digest(*np.linalg.eigh(numbers + numbers.T)))
    print("libm", digest(np.exp(np.linspace(-3, 3, 10_000)), np.tanh(np.linspace(-3, 3, 10_000))))
    for name in sys.argv[1:] or BODIES:
        modes = find_modes(name)
        print(name.replace(" ", "_"), digest(modes.omega, modes.shape(PLACES)))


if __name__ == "__main__":
    sys.exit(main())
