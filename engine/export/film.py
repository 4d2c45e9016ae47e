"""A patch as a film: what a page draws of it (`page/motion.js`), with its sound. Matplotlib and FFmpeg are imported
when the first is made."""

import io
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.build import build
from engine.assembly.scored_changes import scored_tables
from engine.export.faults import CannotExport
from engine.export.motion import Motion, find_motion
from engine.kernel.data.enums import FlightFrame
from engine.offline.simulation import Simulation
from engine.output_files import atomic_write
from engine.patch.scene import Scene

FRAMES_PER_SECOND = 30
BLOCK = 32  # samples, after each of which contacts are looked at
SWINGS = 0.8  # a second, of the lowest mode as it is drawn; this and the next four as in motion.js
MOST_BODIES = 8  # drawn at a time, those that move most
KEPT_SIZE = 0.97  # share of the size of a body that is left in the next picture, at least
EXPONENT = 0.3  # what is quiet can still be seen
FLASH_SECONDS = 0.3  # that a contact can be seen
LEAST_SIZE = 1e-9  # m
SIZE, DPI = (12.8, 7.2), 100  # inches, and pixels an inch
INK, SOFT, CARD, ACCENT = "#1d2129", "#5d6470", "#f5f7f9", "#1f6fb2"  # as in page.css
PEAK = 0.89  # of full scale: -1 dBFS
STILL_SECONDS = 0.5


class MovingBody(NamedTuple):
    """A body of a Motion as it is at a moment, or at the end of a free flight."""

    number: int
    omega: np.ndarray  # [modes], 1/s, as it is now
    q: np.ndarray  # √kg·m
    r: np.ndarray  # momentum by omega, √kg·m
    seconds: float


class Moment(NamedTuple):
    """The motion at a moment."""

    seconds: float
    bodies: list[MovingBody]
    touched: list[int]  # places that were touched since the last moment


def follow_motion(scene: Scene, seconds: float, samplerate: int, **accuracy: Any) -> tuple[Motion, Iterator[Moment]]:
    """Return what is drawn of a scene, and its moments, FRAMES_PER_SECOND. Raises BuildError (a ValueError) if it
    cannot be built, CannotExport if nothing of it is drawn."""
    used = scene.accuracy.replace(**accuracy)
    fine = samplerate * used.oversample
    built = build(scene, fine, used, seconds)
    motion = find_motion(built.layout)
    if not motion.bodies:
        raise CannotExport("a film shows strings, bars, heads and plates that move, and the patch has none")
    simulation = Simulation(
        built.model,
        built.state,
        measure_energy=False,
        tables=scored_tables(scene, built, accuracy=used, seconds=seconds),
    )
    return motion, _moments(simulation, motion, math.ceil(seconds * FRAMES_PER_SECOND), fine, scene.channels)


def _moments(simulation: Simulation, motion: Motion, count: int, samplerate: float, channels: int) -> Iterator[Moment]:
    state, done = simulation.state, 0
    for n in range(count):
        touched, end = set[int](), round(n * samplerate / FRAMES_PER_SECOND)
        while done < end:
            audio = np.zeros((min(BLOCK, end - done), channels))
            simulation.render_block(audio)
            done += len(audio)
            touched |= {k for k, place in enumerate(motion.touched) if state.contact_force[place.contact] != 0.0}
        yield Moment(n / FRAMES_PER_SECOND, _moving_bodies(simulation, motion, done, samplerate), sorted(touched))


def _moving_bodies(simulation: Simulation, motion: Motion, frame: int, samplerate: float) -> list[MovingBody]:
    """Return the bodies that move most."""
    state, omega_squared, bodies = simulation.state, simulation.model.omega_squared, list[MovingBody]()
    energies = [
        float((state.p[body.modes] ** 2 + omega_squared[body.modes] * state.q[body.modes] ** 2).sum())
        for body in motion.bodies
    ]
    for number in sorted(sorted(range(len(energies)), key=lambda n: (-energies[n], n))[:MOST_BODIES]):
        body = motion.bodies[number]
        omega, until = np.sqrt(omega_squared[body.modes]), int(state.flight.frame[body.island, FlightFrame.END])
        at = max(frame, until) / samplerate
        bodies.append(MovingBody(number, omega, state.q[body.modes], state.p[body.modes] / omega, at))
    return bodies


def heights_of(motion: Motion, moving: MovingBody, shown: float) -> np.ndarray:
    """Return the displacements of a body at its places, m: as it was at a moment, turned on by less than half a period
    to the phase that a stroboscope shows at `shown`, s. Partials of a string have one stroboscope, others one each."""
    body, omega = motion.bodies[moving.number], moving.omega
    reference = omega[:1] if body.is_harmonic else omega
    turns = SWINGS * shown * reference / omega[0] - reference * moving.seconds / math.tau
    angle = math.tau * omega / reference * (turns - np.rint(turns))
    sizes = np.array(body.scales) * (moving.q * np.cos(angle) + moving.r * np.sin(angle))
    return np.asarray(sizes @ np.array(motion.shapes[body.shape].values, float))


class FilmPicture:
    """The picture of a film, which changes from moment to moment."""

    def __init__(self, motion: Motion, title: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import LineCollection
        from matplotlib.figure import Figure

        self._motion = motion
        self._sizes: dict[int, tuple[float, float]] = {}  # of a body: now, and the largest so far, m
        self._touched: dict[int, float] = {}  # when each place was touched, s
        self._nearest = [self._place_of(touch.body, touch.place) for touch in motion.touched]
        count = min(MOST_BODIES, len(motion.bodies))
        rows = 1 if count <= 2 else 2
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white", layout="constrained")
        figure.suptitle(title, color=INK, fontsize=20)
        self.canvas: Any = FigureCanvasAgg(figure)
        self._panels = list[tuple[Any, Any, Any]]()
        every = figure.subplots(rows, math.ceil(count / rows), squeeze=False).flat
        for axes in every[count:]:
            axes.remove()
        for axes in every[:count]:
            axes.set(xlim=(-0.03, 1.03), ylim=(-1.0, 1.0), xticks=[], yticks=[], facecolor=CARD)
            axes.spines[:].set_visible(False)
            lines = axes.add_collection(LineCollection([], colors=ACCENT, linewidths=2))
            axes.set_title(" ", fontsize=11)
            self._panels.append((axes, lines, axes.scatter([], [], s=120, zorder=3)))
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # which would be looked for anew in each picture

    def draw(self, moment: Moment) -> bytes:
        """Draw a moment; return the pixels, RGBA."""
        self._touched |= dict.fromkeys(moment.touched, moment.seconds)
        for (axes, lines, dots), moving in zip(self._panels, moment.bodies, strict=False):
            body = self._motion.bodies[moving.number]
            heights = heights_of(self._motion, moving, moment.seconds)
            peak, (size, most) = float(np.abs(heights).max()), self._sizes.get(moving.number, (0.0, 0.0))
            now = max(peak, KEPT_SIZE * size)
            most = max(now, most)
            self._sizes[moving.number] = now, most
            points = self._points_of(
                body.shape, heights * ((now / most) ** EXPONENT / now if now > LEAST_SIZE else 0.0)
            )
            lines.set_segments(self._segments_of(body.shape, points))
            self._draw_touches(dots, moving.number, points, moment.seconds)
            axes.title.set(text=f"{body.name.replace('_', ' ')}, {_length_text(now)}", color=SOFT)
        self.canvas.draw()
        return bytes(self.canvas.buffer_rgba())

    def _place_of(self, body: int, place: Any) -> int:
        """Return the number of the place of a body that is nearest to one."""
        off = np.array(self._motion.shapes[self._motion.bodies[body].shape].places) - np.array(place)
        return int(np.argmin(np.abs(off) if off.ndim == 1 else np.hypot(*off.T)))

    def _points_of(self, shape: int, heights: np.ndarray) -> np.ndarray:
        """Return the points of a body in its panel: a line, or a sheet that is looked at from aside."""
        places = np.array(self._motion.shapes[shape].places)
        if places.ndim == 1:
            return np.stack([places, 0.8 * heights], axis=1)
        x, y = places.T
        return np.stack([(x + 0.4 * y) / 1.4, 0.9 * y - 0.6 + 0.44 * heights], axis=1)

    def _segments_of(self, shape: int, points: np.ndarray) -> Sequence[np.ndarray]:
        """Return a line through points; or those of a grid, to the right and to the next row."""
        _, columns, numbers, _ = self._motion.shapes[shape]
        if not columns:
            return [points]
        at = dict(zip(numbers, points, strict=True))
        right = [(n, n + 1) for n in numbers if (n + 1) % columns and n + 1 in at]
        return [
            np.stack([at[a], at[b]]) for a, b in [*right, *((n, n + columns) for n in numbers if n + columns in at)]
        ]

    def _draw_touches(self, dots: Any, number: int, points: np.ndarray, seconds: float) -> None:
        """Draw dots where a body was touched just now."""
        shown = [
            (points[self._nearest[k]], 1.0 - (seconds - at) / FLASH_SECONDS)
            for k, at in self._touched.items()
            if self._motion.touched[k].body == number and seconds - at < FLASH_SECONDS
        ]
        dots.set_offsets([point for point, _ in shown] or np.zeros((0, 2)))
        dots.set_facecolor([(0.12, 0.44, 0.7, strength) for _, strength in shown])


def _length_text(size: float) -> str:
    if size < 1e-6:
        return "at rest"
    factor, unit = (1e6, "µm") if size < 1e-3 else (1e3, "mm")
    return f"{float(f'{factor * size:.2g}'):g} {unit}"


def still_of(scene: Scene, samplerate: int = 44_100) -> bytes:
    """Return a picture of a scene as it is soon after its beginning, PNG. Raises as `follow_motion`."""
    motion, moments = follow_motion(scene, min(scene.seconds, STILL_SECONDS), samplerate)
    picture, png = FilmPicture(motion, scene.title), io.BytesIO()
    for moment in moments:
        picture.draw(moment)
    picture.canvas.print_png(png)
    return png.getvalue()


def write_film(path: Path, scene: Scene, audio: np.ndarray, samplerate: int, **accuracy: Any) -> None:
    """Write the film of a rendering, MP4. audio: [frames, channels], of the rendering. Raises as `follow_motion`, and
    OSError if it cannot be written."""
    import imageio_ffmpeg
    import soundfile

    seconds = len(audio) / samplerate
    motion, moments = follow_motion(scene, seconds, samplerate, **accuracy)
    picture, pixels = FilmPicture(motion, scene.title), (round(SIZE[0] * DPI), round(SIZE[1] * DPI))
    with atomic_write(path) as part, tempfile.TemporaryDirectory() as folder:
        sound = Path(folder) / "sound.wav"
        soundfile.write(sound, PEAK * audio / max(float(np.abs(audio).max()), 1e-300), samplerate)
        film = imageio_ffmpeg.write_frames(
            str(part),
            pixels,
            pix_fmt_in="rgba",
            fps=FRAMES_PER_SECOND,
            audio_path=str(sound),
            audio_codec="aac",
            ffmpeg_log_level="error",
            output_params=["-ar", "48000", "-ac", str(min(2, audio.shape[1])), "-f", "mp4", "-movflags", "+faststart"],
        )
        film.send(None)
        for moment in moments:
            film.send(picture.draw(moment))
        film.close()
