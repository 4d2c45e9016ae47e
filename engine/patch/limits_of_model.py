"""Words for what the engine does not model, or has under another name: a line each, and a section of docs/limits.md."""

PAGE = "docs/limits.md"

# what is said, the section of the page, and the words that it answers
_ANSWERS: tuple[tuple[str, str, str], ...] = (
    (
        "[[bow]] bows a body; [[friction]] is any surface that rubs, pressed by a force or a contact",
        "friction",
        "bow bowed bowing friction rosin rub rubbing scrape stick_slip",
    ),
    (
        "wind excitation (reeds, lips, jets of air) is not modelled; tubes and boxes of air resonate",
        "wind",
        "reed lips lip jet mouthpiece blow blown wind flute brass whistle",
    ),
    (
        "a patch has no audio effects; render, and add them in an audio editor",
        "effects",
        "reverb room hall convolution delay echo chorus flanger effect effects filter lowpass highpass "
        "bandpass eq equalizer equaliser compressor limiter distortion saturation overdrive amplifier",
    ),
    (
        "polarisations = 2 lets a string move in two directions; other bodies move in one",
        "directions",
        "polarisation polarization horizontal",
    ),
    (
        "there are no waves along a string, and no torsion",
        "directions",
        "longitudinal torsion torsional twist",
    ),
    (
        "axial_stiffness lets a string stretch, and stretching_stiffness a membrane or a plate: the pitch falls with"
        " the amplitude",
        "bodies-that-stretch",
        "nonlinear nonlinearity geometric kirchhoff_carrier von_karman tension_modulation pitch_glide duffing",
    ),
    (
        "a contact is a power law with Hunt-Crossley damping: no hysteresis, no adhesion, no plasticity",
        "contacts",
        "hysteresis relaxation plastic plasticity adhesion sticky magnet",
    ),
    (
        'a [[pickup]] measures a position on a body; quantity = "pressure" is the far field, without a room',
        "sound-radiation",
        "mic microphone radiation directivity binaural hrtf listener speaker",
    ),
    (
        'there are no other shapes than the kinds of bodies; read other modes from a file, with kind = "modes"',
        "shapes",
        "mesh fem geometry stl obj cone horn sphere dome block",
    ),
    (
        'a bell, bowl, glass or gong is kind = "modes": its modes by frequency and decay time, measured or known;'
        ' nearest by shape are kind = "shell", a cylinder, and "plate", a disc',
        "shapes",
        "bell bells glass wine_glass wineglass bowl singing_bowl cup goblet bottle jar vase chime gong cymbal tam_tam"
        " tamtam crotale",
    ),
    (
        "bodies do not break, wear or change",
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
        "there is no modulator: [[event]]s change values, and the pitch wheel bends",
        "ramps",
        "lfo vibrato tremolo modulation glissando portamento",
    ),
    (
        "pan, from -1 to 1, is a key of a [[pickup]]",
        "sound",
        "pan panning balance stereo",
    ),
    (
        "gain is a key of a [[pickup]]; level, dB, is one of the patch; --gain sets the level of the file",
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
    """Return the answer to a word that the engine does not have, or has under another name; "" for other words."""
    return ANSWERS.get(word.lower().replace("-", "_"), "")
