"""How far bowed strings are out of tune, by default and with other numbers of steps, beside an independent simulation
of the same law (bench.accuracy.bow_in_continuous_time)."""

import engine
from bench.accuracy.bow_in_continuous_time import Bowed, cents_of
from bench.publish.report import publish

SECONDS, FROM = 1.5, 0.7  # s: what is rendered, and from when on its pitch counts
RATES = 44_100, 48_000
PITCHES = 100.0, 300.0, 1000.0, 3000.0  # Hz
PLAYED = (0.2, 0.2), (0.6, 0.25), (1.5, 0.6)  # force, N, and velocity, m/s, of the bow
STEPS = None, 1, 4, 16  # of the engine; None: as many as it takes by default
FINE = 64, 256  # of the simulation; a quarter of each at 100 Hz, where strings have many modes


def cents(bowed: Bowed, substeps: int | None = None) -> float:
    """Return how far a bowed string is from the pitch of its first partial, rendered by the engine."""
    scene = engine.load(bowed.patch(SECONDS))
    audio = engine.render(scene, samplerate=int(bowed.rate), substeps=substeps).audio[:, 0]
    return cents_of(audio[round(FROM * bowed.rate) :], bowed.rate, bowed.pitch)


def right_cents(bowed: Bowed) -> tuple[float, float]:
    """Return the same by the independent simulation, in two numbers of steps."""
    parts = 1 if bowed.pitch > 100.0 else 4
    sounds = (bowed.simulate(SECONDS, steps // parts)[round(FROM * bowed.rate) :] for steps in FINE)
    coarse, fine = (cents_of(sound, bowed.rate, bowed.pitch) for sound in sounds)
    return coarse, fine


def run() -> None:
    """Measure and publish."""
    rows = []
    for rate in RATES:
        for pitch in PITCHES:
            for force, velocity in PLAYED:
                bowed = Bowed(pitch, rate, force, velocity)
                shown = [f"{value:.1f}" for value in (*right_cents(bowed), *(cents(bowed, n) for n in STEPS))]
                rows.append([f"{rate}", f"{pitch:g}", f"{force:g}", f"{velocity:g}", *shown])
    head = ["rate", "Hz", "bow, N", "m/s", *(f"simulated, {n} steps" for n in FINE)]
    publish("bowed_pitch", [*head, "default", *(f"{n} per sample" for n in STEPS[1:])], rows)
