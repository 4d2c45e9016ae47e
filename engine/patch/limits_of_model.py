"""Words for what the engine does not model, or has under another name: a line each, and a section of docs/limits.md."""

PAGE = "docs/limits.md"

# what is said, the section of the page, and the words that it answers
_ANSWERS: tuple[tuple[str, str, str], ...] = (
    (
        'friction that sticks and slips is not modelled, and so no bow; [[force]] has kind = "noise"',
        "friction",
        "bow bowed bowing friction rosin rub rubbing scrape stick_slip",
    ),
    (
        "nothing blows: reeds, lips and jets of air are not modelled; tubes and boxes resonate",
        "wind",
        "reed lips lip jet mouthpiece blow blown wind flute brass whistle",
    ),
    (
        "a patch has no effects after the sound; render, and add them in an audio editor",
        "effects",
        "reverb room hall convolution delay echo chorus flanger effect effects filter lowpass highpass "
        "bandpass eq equalizer equaliser compressor limiter distortion saturation overdrive amplifier",
    ),
    (
        "a body moves in one direction: no second polarisation, no longitudinal waves, no torsion",
        "one-direction",
        "polarisation polarization horizontal longitudinal torsion torsional twist",
    ),
    (
        "bodies are linear, only contacts are not: pitch does not depend on loudness",
        "linear-bodies",
        "nonlinear nonlinearity geometric kirchhoff_carrier von_karman tension_modulation pitch_glide duffing",
    ),
    (
        "a contact pushes as a power of its compression, with Hunt-Crossley damping: no memory, no glue, no plasticity",
        "contacts",
        "hysteresis relaxation plastic plasticity adhesion sticky magnet restitution",
    ),
    (
        'a [[pickup]] hears a place of a body; quantity = "pressure" is what is heard far off, without a room',
        "what-is-heard",
        "mic microphone radiation directivity binaural hrtf listener speaker",
    ),
    (
        'shapes are those of the kinds of bodies; modes of any other come from a file, with kind = "modes"',
        "shapes",
        "mesh fem geometry stl obj bell gong cymbal cone horn",
    ),
    (
        "bodies neither break nor change: nothing wears, cracks or is cut",
        "breaking",
        "break crack fracture snap wear temperature humidity",
    ),
    (
        '[[force]] with kind = "noise"',
        "forces",
        "noise white_noise pink_noise breath random",
    ),
    (
        '[[force]] with kind = "sine"',
        "forces",
        "sine sin sinus shaker ebow e_bow vibrator",
    ),
    (
        'a [[force]] has an envelope, [[s, factor], …]; [[event]] with kind = "change" glides for its duration',
        "ramps",
        "ramp fade fade_in fade_out envelope adsr attack automation linseg",
    ),
    (
        "nothing modulates by itself: events change values, as many as you write, and the pitch wheel bends",
        "ramps",
        "lfo vibrato tremolo modulation glissando portamento",
    ),
    (
        "pan, from -1 to 1, is a key of a [[pickup]]",
        "sound",
        "pan panning balance stereo",
    ),
    (
        "gain is a key of a [[pickup]]; --gain sets the level of the file",
        "sound",
        "volume level amp loudness",
    ),
    (
        'a hammer is a [[body]] of kind "mass" with a velocity, and a [[contact]] with what it strikes',
        "sound",
        "hammer mallet stick finger plectrum pick",
    ),
)
ANSWERS = {word: f"{line} ({PAGE}#{anchor})" for line, anchor, words in _ANSWERS for word in words.split()}


def answer_word(word: str) -> str:
    """What is said of a word that the engine does not have, or has under another name; "" of other words."""
    return ANSWERS.get(word.lower().replace("-", "_"), "")
