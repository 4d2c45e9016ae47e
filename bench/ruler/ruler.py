"""The ruler: contact schemes on the same problems, error against time against energy."""

import csv
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.publish.report import RESULTS, figure, pin, publish, stamp
from bench.ruler.chosen import ERRORS, settings_for_error
from bench.ruler.engine_method import simulate_by_engine, simulate_oscillator_by_engine
from bench.ruler.methods import FAMILIES
from bench.ruler.stability import largest_stable_stiffness
from engine.problems import NAMES, Problem, Reference, Score, Trajectory, load_problem, score

SUBSTEPS = (1, 2, 4, 16)
ROUNDING = 1e-16  # what is smaller counts as 0
GOAL = 1e-3  # error of the motion that methods are timed at
MEASURES = ("motion", "force", "bands_db", "energy", "pull", "ns_per_sample")
BY_ERROR = "this engine, max_error"
OWN: dict[str, dict[float, dict[str, float]]] = {  # settings of the engine's methods
    **{f"this engine, order {order}": {n: {"order": order, "substeps": n} for n in SUBSTEPS} for order in (2, 4, 6)},
    BY_ERROR: {error: settings_for_error(error) for error in ERRORS},
}
WITH_TOLERANCES = (BY_ERROR, "DOP853 with events")


class Result(NamedTuple):
    """A score of a method at a setting."""

    problem: str
    family: str
    variant: str
    setting: float  # steps per sample, or a tolerance
    score: Score


def run() -> None:
    """Score all methods on all problems, and publish tables and a plot."""
    pin()
    results = [result for name in NAMES for result in score_problem(name)]
    write_results(results)
    publish_single_step(results)
    publish_times(results)
    draw(results)


# --- scores


def score_problem(name: str) -> Iterator[Result]:
    """The scores of all methods on a problem; of a family, those of its best variant at each setting."""
    problem, reference = load_problem(name)
    for family, settings in OWN.items():
        for setting, accuracy in settings.items():
            trajectory = simulate_by_engine(name, **accuracy)
            yield Result(name, family, family, setting, score(problem, reference, trajectory))
    for family, variants in FAMILIES.items():
        for setting in variants[0].settings:
            scores = [(v.name, score_quietly(problem, reference, v.simulate, setting)) for v in variants]
            variant, best = min(scores, key=lambda pair: _or_infinite(pair[1].motion))
            yield Result(name, family, variant, setting, best)


def score_quietly(
    problem: Problem, reference: Reference, simulate: Callable[[Problem, Any], Trajectory], setting: float
) -> Score:
    """The score of a method, which may blow up."""
    with np.errstate(all="ignore"):
        return score(problem, reference, simulate(problem, setting))


def _or_infinite(value: float) -> float:
    """A value, or infinity in place of NaN."""
    return math.inf if math.isnan(value) else value


# --- tables


def write_results(results: list[Result]) -> None:
    """All scores, as bench/results/ruler_scores.csv."""
    with open(RESULTS / "ruler_scores.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"# {stamp('ruler')}"])
        writer.writerow(["problem", "method", "variant", "setting", *MEASURES, "failed"])
        for result in results:
            values = [f"{result.score[measure]:.3g}" for measure in MEASURES]
            writer.writerow([*result[:3], f"{result.setting:g}", *values, result.score.failed])


def families(results: list[Result]) -> list[str]:
    """The names of all families, in their order."""
    return list(dict.fromkeys(result.family for result in results))


def publish_single_step(results: list[Result]) -> None:
    """One row for each method, at one step per sample (of tolerances, the middle one)."""
    rows = []
    for family in families(results):
        chosen = [r for r in results if r.family == family]
        setting = sorted({r.setting for r in chosen})[1] if family in WITH_TOLERANCES else 1
        scores = [r.score for r in chosen if r.setting == setting]
        done = [s for s in scores if not math.isnan(s.motion)]
        cells = [f"{len(done)} of {len(NAMES)}"]
        cells += [
            _middle([s[m] for s in done], form)
            for m, form in (("motion", ".0e"), ("force", ".0e"), ("bands_db", ".2g"))
        ]
        cells += [_most([s[m] for s in done]) for m in ("energy", "pull")]
        cells += [_stiffness(stable_stiffness(family)), _middle([s.ns_per_sample for s in done], ".0f")]
        rows.append([family, *cells])
    header = ["method, one step per sample", "stable problems", "motion error", "force error", "third-octave error, dB"]
    header += ["largest energy error", "largest pull", "largest stable stiffness, N/m²", "ns per sample"]
    publish("ruler", header, rows)


def publish_times(results: list[Result]) -> None:
    """What each method takes for an error of the motion of GOAL, ns per sample, on each problem."""
    rows = []
    for family in families(results):
        cells = []
        for name in NAMES:
            good = [
                r for r in results if (r.family, r.problem) == (family, name) and _or_infinite(r.score.motion) <= GOAL
            ]
            best = min(good, key=lambda r: r.score.ns_per_sample, default=None)
            cells.append("–" if best is None else f"{best.score.ns_per_sample:.3g} ({best.setting:g})")
        rows.append([family, *cells])
    publish("ruler_time", [f"ns per sample for a motion error of {GOAL:g} (setting)", *NAMES], rows, "ruler")


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
    """Error of the motion against time, a panel for each problem."""
    with figure("ruler", 14.0, 10.5, nrows=3, ncols=4) as panels:
        np.ravel(panels)[0].figure.set_layout_engine(None)
        for name, panel in zip(NAMES, np.ravel(panels), strict=True):
            for i, family in enumerate(families(results)):
                points = [
                    (r.score.ns_per_sample, r.score.motion)
                    for r in results
                    if (r.family, r.problem) == (family, name) and r.score.motion > 0.0
                ]
                if points:
                    is_ours = family.startswith("this engine")
                    style = {
                        "linewidth": 2.2 if is_ours else 1.0,
                        "marker": "o" if is_ours else ".",
                        "color": f"C{i % 10}",
                    }
                    style |= {"linestyle": "-" if i < 10 else "--", "markersize": 5 if is_ours else 4}
                    panel.loglog(*zip(*points, strict=True), label=family, **style)
            panel.set_title(name.replace("_", " "), fontsize=10)
            panel.set_ylim(1e-10, 3.0)
            panel.grid(True, which="major", alpha=0.3)
        for panel in np.atleast_2d(panels)[-1]:
            panel.set_xlabel("ns per sample")
        for panel in np.atleast_2d(panels)[:, 0]:
            panel.set_ylabel("motion error")
        lines = {line.get_label(): line for panel in np.ravel(panels) for line in panel.get_lines()}
        np.ravel(panels)[0].figure.legend(lines.values(), lines, loc="lower center", ncol=5, fontsize=9, frameon=False)
        np.ravel(panels)[0].figure.subplots_adjust(
            bottom=0.13, top=0.95, left=0.06, right=0.98, hspace=0.3, wspace=0.25
        )
