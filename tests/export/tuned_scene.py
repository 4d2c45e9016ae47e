"""Scenes whose score or keys change the tables of a body."""

import tomllib

import engine
from engine.patch.scene import Scene


def tuned_as_it_sounds(name, body):
    """Return a shipped patch whose score tunes a body at once: a glide, a loss, and a jump."""
    text = engine.load(name).model_dump(exclude_unset=True)
    frequency = next(one["frequency"] for one in text["body"] if one["name"] == body)
    changes = [
        {"time": 0.03, "duration": 0.05, "parameter": f"body.{body}.frequency", "value": 1.3 * frequency},
        {"time": 0.1, "parameter": f"body.{body}.sigma0", "value": 20.0},
        {"time": 0.15, "parameter": f"body.{body}.frequency", "value": 0.9 * frequency},
    ]
    events = [*text.get("event", []), *({"kind": "change", **change} for change in changes)]
    return Scene.model_validate(text | {"event": events})


STOPPED_STRING = tomllib.loads("""
title = "A string whose keys stop it"
seconds = 1.0
level = -30.0
note = [
    { time = 0.0, key = "C4", velocity = 80, duration = 0.2 },
    { time = 0.2, key = "E4", velocity = 100, duration = 0.1 },
]

[keyboard]
keys = "C4..E4"

[[key.body]]
name = "hammer"
kind = "mass"
mass = 3e-3
displacement = -2e-3

[[key.contact]]
name = "felt"
body = "hammer"
on = "string"
on_at = 0.12
stiffness = 4.5e9
exponent = 2.5
loss = 0.02

[[key.on]]                     # the string is stopped where the key wants it, and a little higher if struck hard
kind = "change"
parameter = "body.string.frequency"
value = "= 261.6*2**((key - 60)/12) + (v > 0.7)"

[[key.on]]
kind = "strike"
body = "hammer"
displacement = -2e-3
velocity = "= 1 + 3*v"

[[key.off]]
kind = "change"
parameter = "body.string.frequency"
value = 196.0

[[body]]
name = "string"
kind = "string"
length = 0.62
mass = 3.93e-3
frequency = 261.6
inharmonicity = 3.77e-4
sigma0 = 0.5

[[pickup]]
body = "string"
at = 0.3
""")
