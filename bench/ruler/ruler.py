"""The ruler: contact schemes on the same problems, error against time against energy.

`uv run python -m bench.ruler.ruler PROBLEM …` measures some problems, and takes the scores of the others, with the
kernels that they measured, from bench/results.
"""

import csv
import dataclasses
import datetime
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.publish import stale
from bench.publish.report import RESULTS, figure, pin, publish, stamp
from bench.ruler.chosen import ERRORS, settings_for_error
from bench.ruler.contact_ruler import NAMES, Problem, Reference, Score, Trajectory, load_problem, score
from bench.ruler.engine_method import simulate_by_engine, simulate_oscillator_by_engine
from bench.ruler.methods import FAMILIES
from bench.ruler.methods.common import was_applicable
from bench.ruler.problems import SAMPLERATE
from bench.ruler.stability import largest_stable_stiffness

SUBSTEPS = (1, 2, 4, 16)
ROUNDING = 1e-16  # what is smaller counts as 0
GOAL = 1e-3  # error of the motion that methods are timed at
MEASURES = ("motion", "force", "bands_db", "energy", "pull", "ns_per_sample")
BY_ERROR = "this engine, max_error"
OWN: dict[str, dict[float, dict[str, float]]] = {  # settings of the engine's methods
    **{f"this engine, order {order}": {n: {"order": order, "substeps": n} for n in SUBSTEPS} for order in (2, 4, 6)},
    BY_ERROR: {error: settings_for_error(error) for error in ERRORS},
}
NOT_APPLICABLE = "not applicable"  # of a method to a problem
SCORES, STABILITY = RESULTS / "ruler_scores.csv", "largest stable stiffness, N/m²"
WITH_TOLERANCES = (BY_ERROR, "DOP853 with events")
OTHERS = "RK4", "Störmer-Verlet", "SAV, drift control", "DOP853 with events"  # in the picture of docs/accuracy.md
SHOWN, LEFT_OUT = (*OWN, *OTHERS), ("barrier", "lossy_bounce")  # … and problems that are not


class Result(NamedTuple):
    """A score of a method at a setting."""

    problem: str
    family: str
    variant: str
    setting: float  # steps per sample, or a tolerance
    score: Score
    kernels: str  # of the engine, that were measured

    @property
    def is_applicable(self) -> bool:
        """True if the method is made for the problem."""
        return not math.isnan(self.score.ns_per_sample)


def run(names: tuple[str, ...] = NAMES) -> None:
    """Score all methods on all problems, or on some, and publish tables and a plot."""
    pin()
    fresh = [result for name in names for result in score_problem(name)]
    if names == NAMES:
        made, results = stamp("ruler"), fresh
        stiffness = {family: _stiffness(stable_stiffness(family)) for family in families(results)}
    else:
        made, kept = read_results()
        made = add_to_stamp(made, names)
        results = sorted(fresh + [r for r in kept if r.problem not in names], key=lambda r: NAMES.index(r.problem))
        stiffness = read_stiffness()
    write_results(results, made)
    publish_single_step(results, stiffness, made)
    publish_times(results, made)
    draw(results)


def add_to_stamp(made: str, names: tuple[str, ...]) -> str:
    """The stamp of older results, with the problems that are measured now."""
    base, *others = made.split("; ")
    others = [other for other in others if other.partition(":")[0] not in names]
    now = f"{datetime.date.today()}, kernels {stale.measured_kernels()}"
    return "; ".join([base, *others, *(f"{name}: {now}" for name in names)])


# --- scores


def score_problem(name: str) -> Iterator[Result]:
    """The scores of all methods on a problem; of a family, those of its best variant at each setting."""
    (problem, reference), kernels = load_problem(name), stale.measured_kernels()
    for family, settings in OWN.items():
        for setting, accuracy in settings.items():
            trajectory = simulate_by_engine(name, **accuracy)
            yield Result(name, family, family, setting, score(problem, reference, trajectory), kernels)
    for family, variants in FAMILIES.items():
        for setting in variants[0].settings:
            scores = [(v.name, score_quietly(problem, reference, v.simulate, setting)) for v in variants]
            variant, best = min(scores, key=lambda pair: _or_infinite(pair[1].motion))
            yield Result(name, family, variant, setting, best, kernels)


def score_quietly(
    problem: Problem, reference: Reference, simulate: Callable[[Problem, Any], Trajectory], setting: float
) -> Score:
    """The score of a method, which may blow up, or not be made for the problem."""
    with np.errstate(all="ignore"):
        trajectory = simulate(problem, setting)
        values = score(problem, reference, trajectory)
    return values if was_applicable(trajectory) else dataclasses.replace(values, failed=NOT_APPLICABLE)


def _or_infinite(value: float) -> float:
    """A value, or infinity in place of NaN."""
    return math.inf if math.isnan(value) else value


# --- tables


def write_results(results: list[Result], made: str) -> None:
    """All scores, as bench/results/ruler_scores.csv. made: their stamp"""
    with open(SCORES, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"# {made}"])
        writer.writerow(["problem", "method", "variant", "setting", *MEASURES, "failed", "kernels"])
        for result in results:
            values = [f"{result.score[measure]:.3g}" for measure in MEASURES]
            failed = result.score.failed if result.is_applicable else NOT_APPLICABLE
            writer.writerow([*result[:3], f"{result.setting:g}", *values, failed, result.kernels])


def read_results() -> tuple[str, list[Result]]:
    """The stamp of the last results, and all of them."""
    with open(SCORES, newline="", encoding="utf-8") as file:
        made = next(csv.reader(file))[0].removeprefix("# ")
        results = [
            Result(
                *(row[name] for name in ("problem", "method", "variant")),
                float(row["setting"]),
                Score(*(float(row[measure]) for measure in MEASURES), failed=row["failed"]),
                row["kernels"],
            )
            for row in csv.DictReader(file)
        ]
    return made, results


def read_stiffness() -> dict[str, str]:
    """The largest stable stiffness of each family in the last results."""
    with open(RESULTS / "ruler.csv", newline="", encoding="utf-8") as file:
        _, header, *rows = csv.reader(file)
    return {row[0]: row[header.index(STABILITY)] for row in rows}


def families(results: list[Result]) -> list[str]:
    """The names of all families, in their order."""
    return list(dict.fromkeys(result.family for result in results))


def publish_single_step(results: list[Result], stiffness: dict[str, str], made: str) -> None:
    """One row for each method, at one step per sample (of tolerances, the middle one).

    stiffness: the largest stable one of each method; made: the stamp
    """
    rows = []
    for family in families(results):
        chosen = [r for r in results if r.family == family and r.is_applicable]
        setting = sorted({r.setting for r in chosen})[1] if family in WITH_TOLERANCES else 1
        scores = [r.score for r in chosen if r.setting == setting]
        done = [s for s in scores if not math.isnan(s.motion)]
        cells = [f"{len(done)} of {len(scores)}"]
        cells += [
            _middle([s[m] for s in done], form)
            for m, form in (("motion", ".0e"), ("force", ".0e"), ("bands_db", ".2g"))
        ]
        cells += [_most([s[m] for s in done]) for m in ("energy", "pull")]
        cells += [stiffness.get(family, "–"), _middle([s.ns_per_sample for s in done], ".0f")]
        rows.append([family, *cells])
    header = ["method, one step per sample", "stable problems", "motion error", "force error", "third-octave error, dB"]
    header += ["largest energy error", "largest pull", STABILITY, "ns per sample"]
    publish("ruler", header, rows, made=made)


def publish_times(results: list[Result], made: str) -> None:
    """The time of each method for an error of the motion of GOAL, ns per sample, on each problem. made: the stamp"""
    rows = []
    for family in families(results):
        cells = []
        for name in NAMES:
            here = [r for r in results if (r.family, r.problem) == (family, name) and r.is_applicable]
            good = [r for r in here if _or_infinite(r.score.motion) <= GOAL]
            best = min(good, key=lambda r: r.score.ns_per_sample, default=None)
            none = "–" if here else "n/a"
            cells.append(none if best is None else f"{best.score.ns_per_sample:.3g} ({best.setting:g})")
        rows.append([family, *cells])
    publish("ruler_time", [f"ns per sample for a motion error of {GOAL:g} (setting)", *NAMES], rows, made=made)


def stable_stiffness(family: str) -> float:
    """The largest stiffness at which the best variant of a family is stable in one step per sample, N/m²."""
    if family in WITH_TOLERANCES:
        return math.nan
    if family in OWN:
        return largest_stable_stiffness(lambda problem, n: simulate_oscillator_by_engine(problem, **OWN[family][n]))
    return max(largest_stable_stiffness(variant.simulate) for variant in FAMILIES[family])


def _middle(values: list[float], form: str) -> str:
    """The median of the values that are numbers."""
    known = [v for v in values if not math.isnan(v)]
    return f"{float(np.median(known)):{form}}" if known else "–"


def _most(values: list[float]) -> str:
    """The largest of the values that are numbers."""
    known = [v for v in values if not math.isnan(v)]
    if not known:
        return "–"
    return f"{max(known):.0e}" if max(known) > ROUNDING else "0"


def _stiffness(value: float) -> str:
    """A stiffness up to which a method is stable."""
    if math.isnan(value) or value == 0.0:
        return "–"
    return "any" if math.isinf(value) else f"{value:.0e}"


# --- the plot


def draw(results: list[Result]) -> None:
    """Error of the motion against time, a panel for each problem: of all methods, and of a few on most problems."""
    draw_panels("ruler", results, NAMES, columns=5)
    few = [result for result in results if result.family in SHOWN]
    draw_panels("accuracy", few, [name for name in NAMES if name not in LEFT_OUT], columns=4)


def draw_panels(file: str, results: list[Result], names: Sequence[str], columns: int) -> None:
    """Draw a panel for each problem, and the duration of a sample as a line."""
    rows, colours = math.ceil(len(names) / columns), {family: i for i, family in enumerate(families(results))}
    with figure(file, 3.5 * columns, 3.5 * rows, nrows=rows, ncols=columns, sharey=True) as axes:
        panels = np.ravel(axes)
        whole = panels[0].figure
        whole.set_layout_engine(None)
        for panel in panels[len(names) :]:
            panel.set_axis_off()
        for name, panel in zip(names, panels, strict=False):
            panel.axvline(1e9 / SAMPLERATE, color="0.5", linestyle=":", label="real time on one core")
            for family, i in colours.items():
                points = [
                    (r.score.ns_per_sample, r.score.motion)
                    for r in results
                    if (r.family, r.problem) == (family, name) and r.score.motion > 0.0
                ]
                if points:
                    is_ours = family.startswith("this engine")
                    style = {"linewidth": 2.2, "marker": "o", "markersize": 5} if is_ours else {"linewidth": 1.0}
                    style = {"marker": ".", "markersize": 4, "color": f"C{i % 10}"} | style
                    panel.loglog(*zip(*points, strict=True), label=family, linestyle="-" if i < 10 else "--", **style)
            panel.set_title(name.replace("_", " "), fontsize=10)
            panel.set_ylim(1e-10, 3.0)
            panel.grid(True, which="major", alpha=0.3)
        for panel in panels[len(names) - columns : len(names)]:
            panel.set_xlabel("ns per sample")
        for panel in np.atleast_2d(axes)[:, 0]:
            panel.set_ylabel("error of the motion")
        lines = {line.get_label(): line for panel in panels for line in panel.get_lines()}
        whole.legend(lines.values(), lines, loc="lower center", ncol=5, fontsize=9, frameon=False)
        whole.subplots_adjust(bottom=0.13, top=0.95, left=0.06, right=0.98, hspace=0.3, wspace=0.25)


def main(words: list[str]) -> None:
    """Score all methods on the named problems."""
    if not words or (unknown := [name for name in words if name not in NAMES]):
        sys.exit(f"unknown {', '.join(unknown)}; some of {', '.join(NAMES)}" if words else __doc__)
    run(tuple(words))


if __name__ == "__main__":
    main(sys.argv[1:])
