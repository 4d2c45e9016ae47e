"""A material gives a body its modulus, density and losses; what the body says itself comes first."""

import math
from typing import get_args

import numpy as np
import pytest

import engine
from engine.bodies.materials import MATERIALS, MaterialName
from engine.faults import PatchError

BODIES = {
    "bar": {"kind": "bar", "length": 0.3, "width": 0.03, "thickness": 0.005},
    "plate": {"kind": "plate", "size": [0.3, 0.2], "thickness": 0.003},
    "shell": {"kind": "shell", "radius": 0.05, "length": 0.1, "thickness": 0.004},
    "string": {"kind": "string", "length": 0.6, "diameter": 1e-3, "frequency": 110.0},
    "membrane": {"kind": "membrane", "radius": 0.1, "thickness": 2e-4, "frequency": 110.0},
}


def scene_of(body: dict) -> engine.Scene:
    at = 0.3 if body["kind"] in ("bar", "string", "mass") else [0.3, 0.4]
    return engine.load({"body": [{"name": "b", **body}], "pickup": [{"body": "b", "at": at}]})


def body_of(**body):
    return scene_of(body).body[0]


def test_each_material_has_a_name_that_a_patch_may_give():
    assert set(MATERIALS) == set(get_args(MaterialName))


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("kind", BODIES)
def test_numbers_of_a_material_are_those_that_one_could_have_given(kind, material):
    """The same modes as of the body that gives them itself, to the last bit; and a scene as saved has them."""
    of, made = MATERIALS[material], BODIES[kind]
    loss = {"decay": {"kind": "loss_factor", "eta": of.loss_factor}}
    numbers = {
        "bar": {"young": of.young, "density": of.density} | loss,
        "plate": {"young": of.moduli(), "poisson": of.poisson, "area_density": 0.003 * of.density} | loss,
        "shell": {"young": of.young, "poisson": of.poisson, "density": of.density} | loss,
        "string": {"young": of.young, "density": of.density},
        "membrane": {"young": of.young, "poisson": of.poisson, "area_density": 2e-4 * of.density},
    }[kind]
    if kind == "plate" and of.shear:
        numbers["shear"] = of.shear
    saved = engine.load({**scene_of(made | {"material": material}).document})
    for body in (body_of(**made, material=material), saved.body[0]):
        one, other = body.modal_body(8000.0), body_of(**made, **numbers).modal_body(8000.0)
        assert one.omega.tobytes() == other.omega.tobytes() and one.sigma.tobytes() == other.sigma.tobytes()


def test_a_bar_of_steel_sounds_as_its_size_says():
    """f = (4.730)²/(2π·L²)·√(EI/ρA) of a free bar, and T60 = 2.2/(η·f) (Fletcher & Rossing, sec. 2.15)."""
    body = body_of(**BODIES["bar"], material="steel").modal_body(8000.0)
    pitch = 4.730041**2 / (2 * math.pi * 0.3**2) * math.sqrt(2.0e11 * 0.005**2 / 12 / 7850.0)
    assert body.omega[0] / (2 * math.pi) == pytest.approx(pitch, rel=1e-6)
    assert math.log(1000) / body.sigma[0] == pytest.approx(2.2 / (2e-4 * pitch), rel=1e-3)


def test_a_plate_of_wood_is_stiffer_along_its_grain():
    along, across = (
        body_of(kind="plate", size=size, thickness=3e-3, material="spruce", modes=3).modal_body().omega
        for size in ([0.2, 0.3], [0.3, 0.2])
    )
    assert along[0] > 1.5 * across[0]


def test_what_a_body_gives_itself_comes_first():
    own = {"young": 1.9e11, "decay": {"kind": "t60", "t60": [1.0]}}
    body = body_of(**BODIES["bar"], material="steel", **own)
    assert body.young == 1.9e11 and body.density == 7850.0
    np.testing.assert_allclose(body.modal_body(8000.0).sigma[:-2], math.log(1000), rtol=1e-3)
    tuned = body_of(**BODIES["plate"], material="glass", frequency=440.0)
    assert tuned.young is None and tuned.modal_body(8000.0).omega[0] == pytest.approx(2 * math.pi * 440.0, rel=1e-3)
    held = body_of(**BODIES["string"], material="steel", axial_stiffness=0.0)
    assert held.find_stretching(held.modal_body(8000.0).omega) is None


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ({"kind": "bar", "length": 0.3, "material": "stel"}, r'"stel" is not known; .*\'steel\''),
        ({"kind": "bar", "length": 0.3, "material": "steel"}, "young is given, and no width"),
        ({"kind": "bar", "length": 0.3, "mass": 1.0, "frequency": 90.0, "width": 0.1}, "a width of no material"),
        ({"kind": "plate", "size": [0.3, 0.2], "material": "steel"}, "no thickness is given"),
        ({"kind": "string", "length": 0.3, "frequency": 90.0, "material": "steel"}, "no diameter is given"),
        ({"kind": "plate", "radius": 0.1, "thickness": 0.01, "material": "oak"}, "a circle of wood"),
        ({"kind": "mass", "mass": 1.0, "material": "steel"}, "unknown key"),
        ({"kind": "bar", "length": 0.3, "material": ["steel"]}, "material"),
    ],
)
def test_what_a_material_cannot_do_is_said(body, message):
    with pytest.raises(PatchError, match=message):
        scene_of(body)


@pytest.mark.parametrize("kind", ["plate", "membrane"])
def test_a_sheet_of_a_density_and_a_thickness_is_as_heavy_as_they_say(kind):
    made = BODIES[kind] | {"young": 7e10, "density": 2700.0}
    given = BODIES[kind] | {"young": 7e10, "area_density": 2700.0 * BODIES[kind]["thickness"]}
    saved = engine.load({**scene_of(made).document})
    for body in (body_of(**made), saved.body[0]):
        one, other = body.modal_body(8000.0), body_of(**given).modal_body(8000.0)
        assert one.omega.tobytes() == other.omega.tobytes()
        assert one.shape([0.3, 0.4]).tobytes() == other.shape([0.3, 0.4]).tobytes()


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"density": 7.8}, "7.8 kg/m³ is lighter than any sheet; give that of its material; if 7.8 kg/m² is meant"),
        ({"density": 7850.0, "thickness": None}, "7850.0 kg/m³, and no thickness is given; give the thickness in m"),
        ({"density": 7850.0, "area_density": 7.8}, "area_density and density are both given; give one of them"),
    ],
)
def test_a_density_that_cannot_be_that_of_a_sheet_is_refused_with_both_readings(keys, said):
    body = BODIES["plate"] | {"frequency": 100.0} | keys
    with pytest.raises(PatchError) as refused:
        scene_of({key: value for key, value in body.items() if value is not None})
    assert said in str(refused.value) and len(refused.value.faults) == 1
