"""Scenes that Hypothesis draws: masses and oscillators, and stops and other bodies in their way, over many decades. All
have the same effects but felt with memory, so that two special kernels run them all.
"""

from hypothesis import strategies as st

import engine


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda x: 10.0**x)


def either(low: float, high: float) -> st.SearchStrategy[float]:
    return st.one_of(
        st.just(0.0), st.builds(lambda x, sign: sign * x, decades(low, high), st.sampled_from([-1.0, 1.0]))
    )


@st.composite
def scenes(draw, lossless: bool = False) -> engine.Scene:
    """Two or three bodies and up to five contacts, besides a few parts that call for every effect.

    Lossless, stops leave room between them; with loss, they may overlap by 2 mm, and squeeze a body
    with forces that all but cancel.
    """
    loss = st.just(0.0) if lossless else st.one_of(st.just(0.0), decades(-3, 3))
    damping = st.just(0.0) if lossless else st.one_of(st.just(0.0), decades(-1, 4))
    bodies = []
    for i in range(draw(st.integers(2, 3))):
        body = {
            "name": f"b{i}",
            "mass": draw(decades(-3, 2)),
            "damping_rate": draw(damping),
            "displacement": draw(either(-6, -3)),
            "velocity": draw(either(-3, 1.5)),
            "kind": "mass",
        }
        if draw(st.booleans()):
            body |= {"kind": "oscillator", "frequency": draw(decades(0, 4.3))}
        bodies.append(body)
    names = [b["name"] for b in bodies]
    contacts = []
    for _ in range(draw(st.integers(1, 5))):
        body, on = draw(st.permutations(names))[:2]
        contact = {
            "body": body,
            "side": draw(st.sampled_from(["above", "below"])),
            "stiffness": draw(decades(0, 12)),
            "exponent": draw(st.sampled_from([1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 5.0])),
            "loss": draw(loss),
        }
        if not lossless and contact["loss"] == 0.0 and draw(st.booleans()):
            contact["relaxation"] = {"share": draw(st.floats(0.01, 0.99)), "time": draw(decades(-6, 1))}
        place = draw(either(-6, -3))
        if draw(st.booleans()):
            contact |= {"on": on, "gap": abs(place) if lossless else place}
        else:
            outwards = 1.0 if contact["side"] == "above" else -1.0
            contact |= {"barrier": outwards * abs(place) if lossless else place}
        contacts.append(contact)
    spare = {"body": "b0", "stiffness": 1.0, "exponent": 7.7}
    contacts += [
        spare | {"on": "b1", "gap": 1e5},
        spare | {"barrier": 1e5},
        spare | {"barrier": 1e5, "loss": 0.0 if lossless else 1.0},
    ]
    bodies.append(
        {
            "name": "spare",
            "kind": "oscillator",
            "mass": 1.0,
            "frequency": 100.0,
            "damping_rate": 0.0 if lossless else 1.0,
        }
    )
    forces = [{"kind": "half_sine", "body": "b0", "amplitude": 1e-9, "duration": 1e-3}]
    if not lossless:
        forces.append({"kind": "pulse", "body": "b1", "amplitude": draw(either(-6, 4)), "duration": 5e-3})
    return engine.Scene.model_validate(
        {
            "gravity": draw(st.sampled_from([9.81, 1e-9, -9.81])),
            "body": bodies,
            "contact": contacts,
            "force": forces,
            "pickup": [{"body": "b0"}, {"body": "b1", "quantity": "force"}],
        }
    )
