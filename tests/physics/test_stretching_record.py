"""When bodies stretch, and how far their tensions rise."""

import math

import numpy as np
import pytest

import engine
from engine.analysis.profile import profile_scene
from engine.assembly.build import build
from engine.cli import main
from engine.kernel.data.enums import Stretch
from engine.offline.simulation import Simulation
from engine.offline.stretching_record import StretchingRecord

RATE = 44_100
LENGTH, DENSITY, TENSION, AXIAL, DECAY = 0.65, 4e-4, 73.0, 1e4, 8.0
PHI = math.sqrt(2 / (DENSITY * LENGTH))  # of each mode at its maximum
KAPPA = (math.pi / LENGTH) ** 2 / DENSITY
STIFFNESS = AXIAL / (2 * LENGTH)

STRING = {
    "name": "string",
    "kind": "string",
    "length": LENGTH,
    "linear_density": DENSITY,
    "tension": TENSION,
    "axial_stiffness": AXIAL,
    "sigma0": DECAY,
    "modes": 12,
    "residual": False,
}
THICKNESS = 1e-3
PLATE = {
    "name": "plate",
    "kind": "plate",
    "size": [0.2, 0.15],
    "area_density": 7.8,
    "young": 2e11,
    "thickness": THICKNESS,
    "stretching": True,
    "sigma0": 5.0,
    "modes": 10,
}
HAMMER = {"name": "hammer", "kind": "mass", "mass": 5e-3, "velocity": 8.0}
STRIKE = {"body": "hammer", "on": "string", "on_at": 0.31, "stiffness": 1e7, "exponent": 2.5}


def scene(body, *others, **more):
    pickup = [{"body": body["name"], "at": [0.3, 0.3] if body["kind"] == "plate" else 0.3}]
    return engine.Scene.model_validate({"pickup": pickup, **more, "body": [body, *others]})


def first_mode(amplitude):
    return {"kind": "mode", "number": 1, "amplitude": amplitude}


def amplitude_of(relative_rise):
    """Amplitude of the first mode at which the tension rises by this part of itself, m."""
    return PHI * math.sqrt(relative_rise * TENSION / (STIFFNESS * KAPPA))


def recorded(of, seconds, **accuracy):
    return profile_scene(of, seconds, RATE, **accuracy).stretching[0]


def test_a_string_stretches_until_its_partials_rise_by_less_than_may_be_left_out():
    """Its energy falls by e^(-2σt), and its pitch is raised by 1731·K·E/T² cents at most."""
    of_string = recorded(scene(STRING | {"displacement": first_mode(amplitude_of(0.05))}), 1.0)
    energy = 0.05 * TENSION**2 / (2 * STIFFNESS) * (1 + 0.05 / 2)
    end = math.log(1731 * STIFFNESS * energy / TENSION**2 / 0.1) / (2 * DECAY)
    assert of_string.intervals == [[0.0, pytest.approx(end, abs=0.01)]]
    assert of_string.relative_rise == pytest.approx(0.05) and of_string.time == 0.0
    assert of_string.amplitude == pytest.approx(amplitude_of(0.05))


def test_of_two_strings_only_the_loud_one_stretches():
    """Until the other is struck as well."""
    loud = STRING | {"name": "loud", "displacement": first_mode(amplitude_of(0.05))}
    force = {"body": "string", "at": 0.3, "kind": "pulse", "amplitude": 5.0, "start": 0.2, "duration": 2e-3}
    of_scene = profile_scene(scene(loud, STRING, force=[force]), 0.3, RATE).stretching
    first, second = ({of.body: of.intervals for of in of_scene}[name] for name in ("loud", "string"))
    assert first == [[0.0, pytest.approx(0.3, abs=0.01)]]
    (begin, soon), (struck, end) = second
    assert begin == 0.0 and soon < 0.01 and struck == pytest.approx(0.2, abs=0.01) and end > 0.29


@pytest.mark.hard
def test_two_strings_on_a_body_stretch_together():
    """As long as there is energy that the body may carry from one to the other."""
    loud = STRING | {"name": "loud", "displacement": first_mode(amplitude_of(0.05))}
    body = {"name": "body", "kind": "oscillator", "mass": 0.5, "frequency": 100.0, "damping_rate": 50.0}
    ends = [{"kind": "end", "body": name, "at": 1, "on": "body"} for name in ("loud", "string")]
    of_scene = profile_scene(scene(loud, STRING, body, connection=ends), 0.3, RATE).stretching
    assert [of.intervals for of in of_scene] == [[[0.0, pytest.approx(0.3, abs=0.01)]]] * 2


def test_a_string_that_is_struck_again_stretches_again():
    force = {"body": "string", "at": 0.3, "kind": "pulse", "amplitude": 5.0, "start": 0.6, "duration": 2e-3}
    of_string = recorded(scene(STRING | {"displacement": first_mode(amplitude_of(0.05))}, force=[force]), 1.2)
    (begin, first), (second, end) = of_string.intervals
    assert begin == 0.0 and first < second and second == pytest.approx(0.6, abs=2e-3) and end > second


def test_a_string_stretches_from_the_first_sample_of_a_strike_that_meets_it_at_once():
    """The contact closes in the step of the event, before any check."""
    hammer = HAMMER | {"velocity": 0.0, "displacement": -0.05}
    strike = {"kind": "strike", "body": "hammer", "time": 0.5, "velocity": 20.0, "displacement": -1e-4}
    struck = scene(STRING, hammer, contact=[STRIKE], event=[strike])
    of_string = recorded(struck, 0.55)
    assert of_string.intervals[-1][0] == pytest.approx(0.5, abs=2e-3) and of_string.time < 0.51
    assert engine.render(struck, seconds=0.55).stats.energy.error_max < 1e-13


def test_the_largest_rise_follows_from_the_energy():
    """All of it is potential at the turning point: λ/T = √(1 + 4·K·E/T²) - 1 of one mode without losses."""
    speed = 40.0
    energy = (speed / PHI) ** 2 / 2
    exact = math.sqrt(1 + 4 * STIFFNESS * energy / TENSION**2) - 1
    assert exact > 0.1
    string = STRING | {"sigma0": 0.0, "velocity": first_mode(speed)}
    assert recorded(scene(string), 0.02).relative_rise == pytest.approx(exact, rel=5e-3)


def test_the_largest_rise_is_that_of_all_steps():
    struck = scene(STRING, HAMMER, contact=[STRIKE])
    model, state, _ = build(struck, RATE)
    simulation, rises = Simulation(model, state), []
    for _ in range(RATE // 10):
        simulation.render_block(np.zeros((1, 1)))
        rises.append(state.tension.body[:, Stretch.LAST].max())
    of_string = recorded(struck, 0.1)
    assert of_string.rise == max(rises)
    assert of_string.time == pytest.approx(np.argmax(rises) / RATE, abs=1e-4)


def test_a_record_leaves_the_samples_as_they_are():
    struck, blocks = scene(STRING, HAMMER, contact=[STRIKE]), []
    for is_recorded in (False, True):
        model, state, layout = build(struck, RATE)
        renderer = Simulation(model, state)
        renderer = StretchingRecord(renderer, state, layout, 64) if is_recorded else renderer
        blocks.append(np.zeros((RATE // 5, 1)))
        renderer.render_block(blocks[-1])
    assert np.array_equal(*blocks)


def test_inspect_prints_when_a_body_stretches_and_warns(tmp_path, capsys):
    patch = tmp_path / "loud.toml"
    keys = "\n".join(f"{key} = {value!r}".replace("False", "false") for key, value in STRING.items())
    bend = f'displacement = {{ kind = "mode", number = 1, amplitude = {amplitude_of(0.9)} }}'
    patch.write_text(f'[[body]]\n{keys}\n{bend}\n[[pickup]]\nbody = "string"\nat = 0.3\n', "utf-8")
    assert main.main(["inspect", str(patch), "--seconds", "1"]) == 0
    printed = capsys.readouterr()
    (line,) = [line for line in printed.out.splitlines() if line.startswith("string:")]
    assert "stretches from 0.000 s to 0.5" in line and "s, then linear; the tension rises by 65.7 N, 0.9 of" in line
    assert 'loud.toml: "string" moves by' in printed.err and "small slopes" in printed.err
