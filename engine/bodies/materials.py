"""Materials: Young's modulus, Poisson's ratio, density and loss factor, which `material` gives a body. The letters of
sources are those of docs/patches.md (engine.patch.reference_page).
"""

from typing import Any, Literal, NamedTuple

from engine.bodies.table import is_given

LOSSES = ("decay", "t60", "sigma0", "sigma_beta", "sigma_beta3", "b3")  # keys of a body, any of which says its own


class Material(NamedTuple):
    """A material; wood along its grain."""

    young: float  # E, Pa
    poisson: float  # ν
    density: float  # kg/m³
    loss_factor: float  # η
    source: str
    across: float = 0.0  # E_R of quarter-sawn wood across its grain, Pa; 0 of what has one modulus
    shear: float = 0.0  # G_LR of wood, Pa

    def moduli(self) -> float | list[float]:
        """Return its Young's modulus; of wood two, along the grain and across it, Pa."""
        return [self.young, self.across] if self.across else self.young


def _wood(young: float, across: float, shear: float, poisson: float, gravity: float, loss_factor: float) -> Material:
    """From the tables of the Wood Handbook: E_L is a tenth above the modulus in bending, the other moduli are ratios of
    it, and the density at 12 % moisture is 1120 kg/m³ times the specific gravity."""
    stiff = 1.1 * young
    return Material(stiff, poisson, 1120.0 * gravity, loss_factor, "d; η: a", across * stiff, shear * stiff)


MATERIALS = {
    "steel": Material(2.0e11, 0.29, 7850.0, 2e-4, "a; η: b"),
    "iron": Material(1.2e11, 0.26, 7200.0, 1e-3, "c, cast"),
    "aluminium": Material(7.1e10, 0.33, 2700.0, 1e-4, "a; η: b"),
    "brass": Material(1.0e11, 0.35, 8500.0, 5e-4, "a; η: b, less than 1e-3"),
    "bronze": Material(1.05e11, 0.34, 8700.0, 5e-4, "c, of bells"),
    "copper": Material(1.25e11, 0.34, 8900.0, 2e-3, "b"),
    "silver": Material(7.5e10, 0.37, 10_500.0, 1e-3, "c; η: b, less than 3e-3"),
    "glass": Material(6.5e10, 0.23, 2500.0, 1e-3, "b"),
    "porcelain": Material(7.0e10, 0.2, 2400.0, 1e-3, "c"),
    "stoneware": Material(5.0e10, 0.2, 2300.0, 2e-3, "c, of ceramics of clay"),
    "concrete": Material(2.6e10, 0.2, 2300.0, 6e-3, "b"),
    "stone": Material(5.0e10, 0.25, 2650.0, 2e-3, "c, granite"),
    "brick": Material(1.6e10, 0.2, 2000.0, 1.5e-2, "b"),
    "plexiglass": Material(5.6e9, 0.35, 1150.0, 3e-2, "b"),
    "nylon": Material(2.9e9, 0.4, 1140.0, 2e-2, "c"),
    "bone": Material(1.8e10, 0.3, 1900.0, 1e-2, "c"),
    "hard_rubber": Material(2.3e9, 0.4, 1100.0, 2e-2, "b"),
    "plywood": Material(5.4e9, 0.3, 600.0, 1.3e-2, "b"),
    "spruce": _wood(10.8e9, 0.078, 0.064, 0.372, 0.40, 8e-3),  # Sitka spruce
    "cedar": _wood(7.7e9, 0.081, 0.087, 0.378, 0.32, 8e-3),  # western red cedar
    "maple": _wood(12.6e9, 0.132, 0.111, 0.424, 0.63, 1e-2),  # sugar maple
    "oak": _wood(12.3e9, 0.163, 0.086, 0.369, 0.68, 1e-2),  # white oak
    "mahogany": _wood(10.3e9, 0.107, 0.066, 0.314, 0.45, 1e-2),  # Honduras mahogany
}
MaterialName = Literal[
    "steel",
    "iron",
    "aluminium",
    "brass",
    "bronze",
    "copper",
    "silver",
    "glass",
    "porcelain",
    "stoneware",
    "concrete",
    "stone",
    "brick",
    "plexiglass",
    "nylon",
    "bone",
    "hard_rubber",
    "plywood",
    "spruce",
    "cedar",
    "maple",
    "oak",
    "mahogany",
]


def absent_losses(table: dict[str, Any], material: Material) -> dict[str, Any]:
    """Return the decay law of a material for a body that says nothing of its losses; else nothing. table: of the body,
    as it was read"""
    if any(table.get(key) for key in LOSSES):
        return {}
    return {"decay": {"kind": "loss_factor", "eta": material.loss_factor}}


def absent_numbers(table: dict[str, Any], **numbers: Any) -> dict[str, Any]:
    """Return those numbers that a body does not give. table: of the body, as it was read"""
    return {key: number for key, number in numbers.items() if number is not None and not is_given(table, key)}
