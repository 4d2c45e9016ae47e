"""A scene whose score changes the tables of a body."""

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
