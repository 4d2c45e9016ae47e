"""What the bridge does to a tanpura string: spectrograms with it and without, and the rise of the high partials."""

import numpy as np

import engine
from bench.publish.report import ROOT, figure, publish

RATE = 44_100
PITCH = 130.81  # Hz
TIMES = (0.06, 0.25, 0.45, 0.7, 1.0, 1.5)  # s
WINDOW = 0.15  # s


def high_to_low(x: np.ndarray) -> float:
    """Energy of partials 15 to 40 over that of 1 to 5, dB."""
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    number = np.fft.rfftfreq(x.size, 1 / RATE) / PITCH
    high, low = (power[(number > a) & (number < b)].sum() for a, b in ((14.5, 40.5), (0.5, 5.5)))
    return float(10 * np.log10(high / low))


def run() -> None:
    """Render, publish and draw."""
    scene = engine.load(ROOT / "patches" / "tanpura.toml")
    bare = scene.model_copy(update={"contact": []})
    heard = {
        name: engine.render(s, seconds=2.5).audio[:, 0]
        for name, s in (("with the bridge", scene), ("without the bridge", bare))
    }
    rows = []
    for name, audio in heard.items():
        windows = [audio[round(t * RATE) : round((t + WINDOW) * RATE)] for t in TIMES]
        rows.append([name, *(f"{high_to_low(x):+.1f}" for x in windows)])
    publish("jvari", ["level of partials 15 to 40 relative to 1 to 5, dB, at", *(f"{t:g} s" for t in TIMES)], rows)
    with figure("jvari", 11.0, 4.2, ncols=2, sharey=True) as panels:
        loudest = max(np.abs(audio).max() for audio in heard.values())
        for axes, (name, audio) in zip(panels, heard.items(), strict=True):
            axes.specgram(audio / loudest, 2048, RATE, noverlap=1792, vmin=-145, vmax=-40, cmap="magma")
            axes.set(title=f"tanpura string {name}", xlabel="time, s", ylim=(0, 8000))
        panels[0].set_ylabel("frequency, Hz")
