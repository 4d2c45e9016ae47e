"""Rows of events for the queue of an audio thread: strikes, plucks, dampers, changes. Player and exports share them."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from engine.argument_checks import checked_number
from engine.assembly.build import BuildResult, nominal_stiffness
from engine.assembly.event_table import EventRow, event_rows
from engine.assembly.external_forces import PluckPoint
from engine.assembly.one_way_drive import DriveForce
from engine.bodies import Mass, Oscillator
from engine.kernel.data.enums import EventKind
from engine.live.event_queue import make_event
from engine.live.voices import striker_velocities
from engine.patch.live_parameters import LivePath
from engine.patch.scene import Scene
from engine.patch.tables import (
    ChangeEvent,
    DampEvent,
    Event,
    LastingForce,
    LiftEvent,
    PluckEvent,
    PluckForce,
    StrikeEvent,
)

MUTE_SIGMA, MUTE_SECONDS = 40.0, 0.4  # decay rate, 1/s, and how long it damps
MAX_SCALE = 1e6  # of a pluck


class EventRows:
    """Makes rows for a scene that is played: each method returns those that do what it says.

    patch:  as it was given
    layout: of what is played: the patch, or so many voices of it
    force_sizes: number of samples of the table of each external force
    input:  number of the force that stands for audio input, which nobody plucks; None without
    """

    input: int | None = None

    def __init__(self, patch: Scene, built: BuildResult, samplerate: int, voices: int) -> None:
        self.patch, self.layout, self.samplerate, self.voices = patch, built.layout, samplerate, voices
        force = built.model.force
        self.force_sizes = (force.table_end - force.table_begin).tolist()
        self._lifts: dict[str, list[EventRow]] = {}  # by body: each pluck wants them

    # --- what there is

    @cached_property
    def strikers(self) -> list[str]:
        """Masses and oscillators that are thrown, at first or by an event; of all voices."""
        names = list(striker_velocities(self.patch))
        return [f"{name}_{n}" for n in range(self.voices) for name in names] if self.voices else names

    @property
    def plucked(self) -> list[str]:
        """Bodies that `pluck` can pluck; of all voices."""
        return list(dict.fromkeys([*(force.body for _, force in self._brief_forces()), *self._scored_plucks]))

    @property
    def plucked_at_first(self) -> list[str]:
        """Bodies that a pluck under [[force]] plucks."""
        return list(dict.fromkeys(f.body for f in self.layout.islands.forces if isinstance(f, PluckForce)))

    def default_velocity(self, striker: str) -> float:
        """Velocity at which a hammer is thrown at time 0, or else first, m/s."""
        return striker_velocities(self.patch).get(striker.rpartition("_")[0] if self.voices else striker, 0.0)

    def body(self, name: str) -> Any:
        """Return a body. Raises KeyError if there is none of this name."""
        if name not in self.layout.body_index:
            raise KeyError(f"there is no body {name}; the bodies are {', '.join(self.layout.body_index)}")
        return self.layout.scene.body[self.layout.body_index[name]]

    def _brief_forces(self) -> list[tuple[int, Any]]:
        """The forces that are over after a while, by their place in the model."""
        forces = enumerate(self.layout.islands.forces)
        return [
            (j, force)
            for j, force in forces
            if not isinstance(force, LastingForce | PluckPoint | DriveForce) and j != self.input
        ]

    # --- what is to be done; the arguments are those of Player

    def strike(self, body: str, velocity: float | None, displacement: float | None) -> list[EventRow]:
        """Launch a hammer."""
        if not isinstance(self.body(body), Mass | Oscillator):
            strikers = f"the hammers are {', '.join(self.strikers)}" if self.strikers else "the patch has no hammers"
            raise KeyError(f"{body} is not a hammer; {strikers}")
        speed = self.default_velocity(body) if velocity is None else velocity
        event = make_event(StrikeEvent, kind="strike", body=body, velocity=speed, displacement=displacement)
        return [row._replace(kind=EventKind.LAUNCH_AND_LIFT) for row in self.of_event(event)]

    def pluck(self, body: str, scale: float, places: Sequence[int] | None = None) -> list[EventRow]:
        """Let the forces of a body that are over after a while act again; or the first pluck of its score, if there is
        no such force. places: of these forces, in their order; all if None"""
        if not 0.0 < checked_number("scale", scale) <= MAX_SCALE:
            raise ValueError(f"scale = {scale:g} is out of range; give more than 0, at most {MAX_SCALE:.0e}")
        self.body(body)
        chosen = [j for j, force in self._brief_forces() if force.body == body]
        if not chosen and body in self._scored_plucks:
            event = self._scored_plucks[body]
            return self.of_event(event.model_copy(update={"time": 0.0, "amplitude": scale * event.amplitude}))
        if not chosen:
            raise KeyError(f"no force plucks {body}; the plucked bodies are {', '.join(self.plucked) or 'none'}")
        return [self.force_again(j, scale) for j in (chosen if places is None else [chosen[n] for n in places])]

    def force_again(self, number: int, scale: float, frames: int | None = None) -> EventRow:
        """Let a force act again. number: of all external forces; frames: of its table that act, all if None"""
        island, size = self._force_islands[number], self.force_sizes[number]
        place, length = number - self._force_islands.index(island), max(1, size if frames is None else frames)
        return EventRow(EventKind.FORCE_AGAIN, island, place, place + 1, 0, length, scale)

    @cached_property
    def _force_islands(self) -> list[int]:
        """Island of each external force."""
        of_body, index = self.layout.islands.of_body, self.layout.body_index
        return [of_body[index[force.body]] for force in self.layout.islands.forces]

    @cached_property
    def _scored_plucks(self) -> dict[str, PluckEvent]:
        """The first pluck of the score of each body."""
        events = [event for event in self.layout.scene.event if isinstance(event, PluckEvent) and event.amplitude]
        return {event.body: event for event in reversed(events)}

    def lift(self, body: str) -> list[EventRow]:
        """Lift the dampers of a body."""
        if body not in self._lifts:
            self.body(body)
            event = make_event(LiftEvent, kind="lift", body=body)
            self._lifts[body] = [row._replace(value=1.0) for row in self.of_event(event)]
        return self._lifts[body]

    def damp(self, body: str, sigma: float, seconds: float) -> list[EventRow]:
        """Damp a body for a while."""
        self.body(body)
        return self.of_event(make_event(DampEvent, kind="damp", body=body, sigma=sigma, duration=seconds))

    def change(self, path: LivePath, parameter: str, value: float, seconds: float) -> list[EventRow]:
        """Let a live parameter glide that the audio thread glides. parameter: its path as it was written"""
        keys = {path.section: path.name, str(path.keys[0]): value}
        return self.of_event(make_event(ChangeEvent, parameter, kind="change", duration=seconds, **keys))

    def of_event(self, event: Event) -> list[EventRow]:
        """Return an event as rows of the score."""
        return event_rows(self.layout, event, self._stiffness, self.samplerate)

    @cached_property
    def _stiffness(self) -> Any:
        return nominal_stiffness(self.layout)
