"""Words that one may look for in a patch, and what the engine calls it."""

from engine.patch.limits_of_model import answer_word

JOIN = '[[connection]] joins bodies: a spring, a damper, rigid = true, or kind = "end" for the end of a string'
END = '[[connection]] with kind = "end" attaches the end of a string to a body'
TOUCH = "bridge = { … } of a [[contact]] is a bridge on which the string buzzes"

# by the section that a key stands in, "" for a key or table of the patch itself
KEYS: dict[str, dict[str, str]] = {
    "": dict.fromkeys(("spring", "joint", "glue", "damper", "bond", "constraint", "connections", "coupling"), JOIN)
    | dict.fromkeys(("bridge", "board", "soundboard", "end"), f"{END}; {TOUCH}"),
    "body": dict.fromkeys(("spring", "springs", "glue", "joint", "connection", "damper", "rigid", "attach", "on"), JOIN)
    | dict.fromkeys(("bridge", "board", "soundboard", "end", "termination"), f"{END}; {TOUCH}")
    | {"height": "the height of a shell is its length"}
    | dict.fromkeys(("youngs_modulus", "elastic_modulus"), "Young's modulus is young, Pa")
    | {"sigma1": 'the decay rate per wave number β is sigma_beta, m/s; per β² it is of decay = { kind = "bilbao" }'}
    | {"sigma3": "the decay rate per wave number β³ is sigma_beta3, m³/s"},
    "contact": dict.fromkeys(
        ("glue", "joint", "rigid", "rest", "damping", "damping_coefficient"), f"a contact only pushes; {JOIN}"
    ),
    "connection": {
        **dict.fromkeys(
            ("gap", "barrier"), "rest, m: displacement of the first body relative to the second without force"
        ),
        **dict.fromkeys(("exponent", "loss"), "a connection is linear; a [[contact]] has an exponent and a loss"),
        **dict.fromkeys(("glue", "joint", "fixed"), "rigid = true"),
    },
}
END_KEYS = ("stiffness", "damping", "damping_coefficient", "rigid", "rest")  # of connections, but not of ends

# by section, what a kind may be meant by
KINDS: dict[str, dict[str, str]] = {
    "body": dict.fromkeys(("spring", "damper", "joint"), JOIN)
    | {"bridge": f"{END}; {TOUCH}"}
    | {"board": 'kind = "soundboard", "plate" or measured "modes"; strings end on it by [[connection]]'}
    | dict.fromkeys(("box", "cavity", "helmholtz"), 'kind = "air": the air in a box, with or without a hole')
    | dict.fromkeys(("resonator", "pipe"), 'kind = "tube"; of a box with a hole, kind = "air"')
    | dict.fromkeys(("drum", "head", "skin"), 'kind = "membrane"; the shell of a drum is kind = "shell"')
    | {"cylinder": 'kind = "shell"', "ball": 'kind = "mass"', "spring_mass": 'kind = "oscillator"'}
    | dict.fromkeys(("beam", "rod", "tine", "tongue", "fork"), 'kind = "bar"')
    | dict.fromkeys(("wire", "cord"), 'kind = "string"')
    | dict.fromkeys(("disc", "disk", "sheet"), 'kind = "plate", with a radius or a size'),
    "connection": dict.fromkeys(("glue", "rigid", "joint", "fixed", "weld"), 'kind = "spring" with rigid = true')
    | dict.fromkeys(("cavity", "volume", "box"), 'kind = "air"')
    | dict.fromkeys(("drive", "one_way"), 'kind = "end" with one_way = true')
    | {"damper": 'kind = "spring" with a damping_coefficient', "dashpot": 'kind = "spring" with a damping_coefficient'}
    | dict.fromkeys(("bridge", "string_end"), 'kind = "end"'),
}


# by the section or key that a kind stands in, the page that says which there are and what is of each
PAGES = {
    "body": "docs/patches.md#bodies-body",
    "connection": "docs/patches.md#connections-connection",
    "force": "docs/patches.md#forces-force",
    "event": "docs/patches.md#events-event",
    "control": "docs/patches.md#controls-control",
    "decay": "docs/bodies.md#damping",
    "displacement": "docs/bodies.md#initial-state",
    "velocity": "docs/bodies.md#initial-state",
}


def explain_key(section: str, key: str, kinds: list[str]) -> str:
    """Return the name that an unknown key has here, or ""; kinds: of the table with that key"""
    if section == "connection" and kinds == ["end"] and key in END_KEYS:
        return "an end has none: the tension of the string acts there"
    return KEYS.get(section, {}).get(key.lower(), "") or answer_word(key)


def explain_kind(section: str, kind: str) -> str:
    """Return the name that an unknown kind has here, or ""."""
    return KINDS.get(section, {}).get(kind.lower(), "") or answer_word(kind)
