"""Text on the console: summaries of a rendering, a profile, a work-precision study and a sweep."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.output_files import SILENT_PEAK, largest_safe_gain

if TYPE_CHECKING:
    from engine.analysis.profile import Profile
    from engine.analysis.work_precision import WorkPrecisionStudy

MAX_LISTED_BOWS = 12
MAX_LISTED_ISLANDS = 32
MAX_LISTED_INTERVALS = 3
LAST_INTERVAL_MARGIN = 1e-3  # s before the end: what ends later lasts to the end
BRANCH_NAMES = {"capped": "iteration limit reached"}  # of solves, where they differ from those of `--json`
SMALLEST_SHOWN_ERROR = 1e-12  # of the sound: less is rounding
REAL_TIME_MARGIN = 0.8  # of the time there is, that a scene should take


def print_summary(stats: dict[str, Any], companions: list[str], verbose: bool = False) -> None:
    """Print the length, level, speed and file of a rendering, the answers to other options, and warnings.

    companions: the files written beside the sound
    verbose:    print all statistics
    """
    rows = {"also wrote": ", ".join(companions)} if companions else {}
    print_rows((detailed_rows if verbose else summary_rows)(stats) | rows)
    print(stats["output"])


def print_rows(rows: dict[str, str]) -> None:
    """Print a line for each row: its heading and its text."""
    for name, value in rows.items():
        print(f"{name:<18} {value}")


def print_notes_summary(stats: dict[str, Any], voices: int, verbose: bool = False) -> None:
    """Print the same of the notes of a MIDI file, rendered by the voices of a patch. stats: as `--json` prints them"""
    rows = dict[str, str]()
    if verbose:
        rows = {name: f"plays {notes}" for name, notes in stats["notes"].items()}
        rows["kernel"] = stats["kernel"]
        rows["energy error"] = f"{stats['live']['energy_error']:.1e} of the maximum stored energy"
    print_rows(_headline_rows(stats, f", {voices} voices") | rows | _alarm_rows(stats))
    print(stats["output"])


def print_mix_summary(stats: dict[str, Any]) -> None:
    """Print the same of a mix, with a line for each of its patches. stats: as `--json` prints them"""
    rows = {"length": _describe_length(stats), "level": _describe_peak(stats)}
    for part in stats["parts"]:
        channels = ", ".join(str(channel) for channel in sorted({one["channel"] for one in part["parts"]}))
        name = f"{Path(part['patch']).stem} ({channels})"
        name += "" if name not in rows else f" {len(rows) - 1}"  # the same patch at another level
        rows[name] = (
            f"gain {part['gain_db']:+.1f} dB on SI units, {format_factor(part['real_time_factor'])} real time,"
            f" energy error {part['energy_error']:.1e}"
        )
    print_rows(rows | _alarm_rows(stats))
    print(stats["output"])


def summary_rows(stats: dict[str, Any]) -> dict[str, str]:
    """Describe a rendering in words, by headings: the main numbers, the estimated error, and warnings."""
    cores = f" on {stats['cores']} cores" if stats["cores"] > 1 else ""
    return _headline_rows(stats, cores) | _error_rows(stats) | _alarm_rows(stats)


def detailed_rows(stats: dict[str, Any]) -> dict[str, str]:
    """All statistics of a rendering in words, by headings."""
    cores = f" on {stats['cores']} cores" if stats["cores"] > 1 else ""
    return _headline_rows(stats, cores) | _detail_rows(stats) | _error_rows(stats) | _alarm_rows(stats)


def _headline_rows(stats: dict[str, Any], shared_by: str) -> dict[str, str]:
    """Length, level and speed. shared_by: cores or voices, if there are several"""
    return {
        "length": _describe_length(stats),
        "level": _describe_level(stats),
        "speed": f"{describe_speed(stats['real_time_factor'])}{shared_by}",
    }


def _describe_length(stats: dict[str, Any]) -> str:
    """Return the length of a sound, its sample rate and its channels in words."""
    channels = {1: "mono", 2: "stereo"}.get(stats["channels"], f"{stats['channels']} channels")
    return f"{stats['seconds']:g} s at {stats['samplerate']} Hz, {channels}"


def _alarm_rows(stats: dict[str, Any]) -> dict[str, str]:
    """Why a rendering is not to be trusted; none where it is."""
    return {} if stats["trusted"] else {"NOT TO BE TRUSTED": "; ".join(stats["reasons"])}


def _detail_rows(stats: dict[str, Any]) -> dict[str, str]:
    """Iterations, energies, effects and activity, and what would make a slow scene playable."""
    newton, energy, activity = stats["newton"], stats["energy"], stats["activity"]
    factor = stats["real_time_factor"]
    outcomes = newton["solve_outcomes"]
    iterations = f"mean {newton['mean']:.2f}, p99 {newton['p99']}, max {newton['max']}; "
    iterations += ", ".join(f"{n}: {count}" for n, count in enumerate(newton["histogram"]) if count)
    samples = max(1, sum(outcomes.values()))
    shares = ", ".join(
        f"{BRANCH_NAMES.get(name, name.replace('_', ' '))} {n / samples:.2%}" for name, n in outcomes.items() if n
    )
    return {
        "kernel": stats["kernel"],
        "tables": stats["table_digest"],
        "cost": f"{stats['ns_per_sample']:.1f} ns per sample",
        "Newton iterations": iterations if newton["solves"] else "none",
        "solver branches": shares or "no contacts",
        "energy error": f"{energy['error_max']:.1e} of the maximum stored energy,"
        f" {energy['error_per_step_max']:.1e} per step",
        "energy": f"{energy['initial']:.4g} J initial, {energy['supplied']:.4g} supplied,"
        f" {energy['dissipated']:.4g} dissipated, {energy['final']:.4g} final",
        "enabled": ", ".join(stats["effects"]["compiled"]) or "none",
        "disabled": ", ".join(stats["effects"]["left_out"]) or "none",
        "time": f"{activity['free']:.1%} free, {activity['contact']:.1%} in contact, {activity['asleep']:.1%} inactive",
    } | ({"to play it live": explain_slowness(stats["islands"], factor)} if factor < 1.0 else {})


def _describe_level(stats: dict[str, Any]) -> str:
    """Return the peak of a file and its gain, or why it is silent."""
    if stats.get("silent"):
        return f"silent: {stats['silent']}"
    gain = "" if stats["peak_file"] <= SILENT_PEAK else f", gain {stats['gain_db']:+.1f} dB on SI units"
    return _describe_peak(stats) + gain


def _describe_peak(stats: dict[str, Any]) -> str:
    """Return the peak of a file, and whether it is above full scale."""
    peak = stats["peak_file"]
    if peak <= SILENT_PEAK:
        return "silent"
    level = f"peak {20 * math.log10(peak):.1f} dBFS"
    if peak > 1.0:
        cut = f"{stats['clipped']} samples are clipped" if stats.get("clipped") else "players will clip it"
        level += f" (above full scale: {cut}; --gain {largest_safe_gain(stats['gain_db'], peak):.1f} fits)"
    return level


def _error_rows(stats: dict[str, Any]) -> dict[str, str]:
    """A row of the estimated error, if there is one."""
    estimate, target = stats.get("error_estimate"), stats.get("target_error")
    if not estimate:
        return {}
    text = _describe_estimate(estimate, stats["seconds"])
    text += f"; MORE THAN {target:.1g}" if target and not estimate["motion"] <= target else ""
    rows = {"estimated error": text}
    if estimate["rounding"] > 0.0:
        rows["rounded times"] = (
            f"{estimate['rounding']:.1g} of the sound, beside it: times of the patch are rounded to samples"
        )
    return rows | ({"not estimated": "; ".join(estimate["left_out"])} if estimate["left_out"] else {})


def _describe_estimate(estimate: dict[str, Any], seconds: float) -> str:
    """Describe an estimate by a second rendering. seconds: length of the sound"""
    if math.isnan(estimate["motion"]):
        return "unknown: there is no finer setting"
    size = (
        f"{estimate['motion']:.1g}" if estimate["motion"] > SMALLEST_SHOWN_ERROR else f"below {SMALLEST_SHOWN_ERROR:g}"
    )
    text, is_whole = f"{size} of the sound", estimate["seconds"] > 0.99 * seconds
    if estimate["horizon"] == 0.0:
        text += ", which differs from a finer rendering from the start"
    elif estimate["horizon"] <= estimate["begin"]:
        text += f", which differs from a finer rendering from the first contact on, at {estimate['begin']:.3g} s"
    elif estimate["horizon"] < estimate["seconds"]:
        text += f" up to {estimate['horizon']:.3g} s, and {estimate['whole']:.1g} up to {estimate['seconds']:.3g} s,"
        text += " where it differs from a finer rendering"
    elif not is_whole:
        text += f" up to {estimate['seconds']:.3g} s; --error-estimate compares all of it"
    if not is_whole:
        return text
    finer = f"order {estimate['finer']['order']}, {estimate['finer']['substeps']} ×"
    if error := estimate["finer"]["max_error"]:
        finer = f"max error {error:.1g}"
    if rate := estimate["finer"].get("samplerate"):
        finer += f", {rate} Hz"
    return f"{text} (compared with {finer}, which took {estimate['time_factor']:.2g} times as long)"


def format_factor(factor: float) -> str:
    """A factor as text, such as 0.39 ×, 1.2 × or 120 ×."""
    return f"{factor:.2g} ×" if factor < 9.95 else f"{factor:.0f} ×"


def describe_speed(factor: float) -> str:
    """The speed of a rendering in words. factor: of real time"""
    return f"{format_factor(factor)} real time" if factor >= 1.0 else f"slower than real time: {format_factor(factor)}"


def explain_slowness(islands: Any, factor: float) -> str:
    """Why a scene runs at a factor of real time below 1, and what would help: cost grows with the modes, and with the
    square of the points of contact (engine.assembly.subsystems).

    islands: as engine.offline.statistics.island_statistics gives them, or a dict of the same
    """
    largest, count = islands["largest"], islands["count"]
    modes, contacts, bodies = largest["modes"], largest["contacts"], largest["bodies"]
    reason = f"the coupled subsystem of {', '.join(bodies[:4])}{' …' if len(bodies) > 4 else ''} has"
    reason += f" {modes} modes and {contacts} contact points"
    reason += f", the largest of {count} subsystems" if count > 1 else ""
    goal = REAL_TIME_MARGIN * factor
    if count > 1:
        reason += f"; the total cost must fall to {goal:.2g} of this"
        return f"{reason}: the command inspect shows the cost of each subsystem"
    if modes * (1 + contacts / 4) >= contacts**2:
        return f"{reason}; about {max(1, int(modes * goal))} modes would be fast enough"
    return f"{reason}; about {max(1, int(contacts * math.sqrt(goal)))} contact points would be fast enough"


def print_profile(profile: "Profile", seconds: float) -> None:
    """Print islands, effects and costs (engine.analysis.profile) of the first seconds of a scene."""
    print(
        f"kernel {profile['kernel']}; costs in ns per sample on one core, with the energy balance, over {seconds:g} s"
    )
    print_table(island_rows(profile))
    if len(profile["islands"]) > MAX_LISTED_ISLANDS:
        print(f"… {len(profile['islands'])} islands in total; --json lists all of them")
    for name, remark in [*effect_rows(profile), *stretching_rows(profile, seconds)]:
        print(f"{name:<24} {remark}")
    print_friction(profile)


def print_friction(profile: "Profile") -> None:
    """Print the forces of bows beside their limits, and where the forces of other friction come from."""
    for line in profile["friction"][:MAX_LISTED_BOWS]:
        print(line)
    if len(profile["friction"]) > MAX_LISTED_BOWS:
        print(f"… {len(profile['friction'])} lines of friction in total; --json lists all of them")


def effect_rows(profile: "Profile") -> Iterator[tuple[str, str]]:
    """Yield the effects and contacts of a profile, and if they are enabled. `--json` keeps older words."""
    for name, remark in profile["effects"].items():
        yield name, remark.replace("compiled in", "enabled").replace("left out", "disabled", 1)
    for remark in profile["contacts_left_out"]:
        yield "disabled contact", remark


def stretching_rows(profile: "Profile", seconds: float) -> Iterator[tuple[str, str]]:
    """Yield the first bodies that stretch, with when they do in so many seconds, and how far their tensions rise."""
    for body in profile["stretching"][:MAX_LISTED_ISLANDS]:
        remark = describe_intervals(body["intervals"], seconds)
        if body["rise"] > 0.0:
            relative = "" if body["relative_rise"] is None else f", {body['relative_rise']:.2g} of that at rest,"
            motion = f"{1e3 * body['amplitude']:.3g} mm from rest"
            remark += (
                f"; the tension rises by {body['rise']:.3g} {body['unit']}{relative} at {body['time']:.3f} s, {motion}"
            )
        yield f"{body['body']}:", remark


def describe_intervals(intervals: list[list[float]], seconds: float) -> str:
    """Describe when a body stretches, such as "stretches from 0.000 s to 0.412 s, then linear"."""
    if not intervals:
        return "linear throughout"
    spans = [f"from {begin:.3f} s to {end:.3f} s" for begin, end in intervals]
    if len(spans) > MAX_LISTED_INTERVALS:
        total = sum(end - begin for begin, end in intervals)
        spans[MAX_LISTED_INTERVALS:] = [f"… ({len(spans)} times, {total:.3f} s in all)"]
    is_linear = intervals[-1][1] < seconds - LAST_INTERVAL_MARGIN
    return f"stretches {', '.join(spans)}{', then linear' if is_linear else ''}"


def island_rows(profile: "Profile") -> list[tuple[str, ...]]:
    """The first islands of a profile as rows of cells, their heads first."""
    heads = "island|modes|dropped|residual|contacts|solver|energy, J|mean|worst case|free/contact/inactive"
    rows: list[tuple[str, ...]] = [tuple(heads.split("|"))]
    for island in profile["islands"][:MAX_LISTED_ISLANDS]:
        names = ", ".join(island["bodies"][:3]) + (" …" if len(island["bodies"]) > 3 else "")
        shares = "/".join(f"{island['activity'][s]:.0%}" for s in ("free", "contact", "asleep"))
        costs = tuple(f"{island[f'ns_{c}']:.0f}" for c in ("mean", "busiest"))
        counts = tuple(str(island[c]) for c in ("modes", "modes_dropped", "modes_residual", "contacts"))
        rows.append((names, *counts, island["solver"], f"{island['energy']:.3g}", *costs, shares))
    return rows


def print_table(rows: list[tuple[str, ...]]) -> None:
    """Print rows of cells in columns as wide as they need."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def print_work_precision(study: "WorkPrecisionStudy") -> None:
    """Print error and time of every setting (engine.analysis.work_precision)."""
    if study["unmeasured"]:
        print(study["verdict"])
        return
    print(reference_note(study))
    print_table(work_precision_rows(study))
    print("* Pareto-optimal: no other setting is faster and no less accurate")
    print(study["verdict"])
    if study["left_out"]:
        print(f"not in the errors: {'; '.join(study['left_out'])}")


def reference_note(study: "WorkPrecisionStudy") -> str:
    """Describe the reference of the errors, and its own error."""
    return (
        f"error over the first {study['horizon'] * 1e3:.0f} ms against {study['reference']}, which is converged to"
        f" {study['disagreement']:.0e}; the spread of the bands is {study['spread_db']:.2g} dB"
    )


def work_precision_rows(study: "WorkPrecisionStudy") -> list[tuple[str, ...]]:
    """Settings as rows of cells, their heads first. A star marks those that are Pareto-optimal."""
    head = "setting", "error", "bands", "decay", "pitch", "1st contact", "rebound", "impulse", "ns/sample", "real time"
    rows: list[tuple[str, ...]] = [("", *head, "Newton mean/p99/max", "energy error")]
    for row in study["rows"]:
        newton = row["newton"]
        rows.append(
            (
                "*" if row["front"] else "",
                row["setting"],
                f"{row['error']:.1e}",
                f"{row['bands_db']:.2f} dB",
                f"{row['decay_db']:.2f} dB",
                f"{row['cents']:+.2f} c",
                "" if math.isnan(row["first_contact_ms"]) else f"{row['first_contact_ms']:.2f} ms",
                "" if math.isnan(row["rebound"]) else f"{row['rebound']:+.4f} m/s",
                f"{row['impulse']:.1e}",
                f"{row['ns_per_sample']:.0f}",
                format_factor(row["real_time_factor"]),
                f"{newton['mean']:.2f}/{newton['p99']}/{newton['max']}",
                f"{row['energy_error']:.0e}",
            )
        )
    return rows


def print_sweep(outcome: dict[str, Any]) -> None:
    """Print how a sweep went, and where its sounds are (engine.sweep.sweep)."""
    done, points, failed = outcome["done"], outcome["points"], outcome["failed"]
    before = f", {outcome['before']} of them earlier" if outcome["before"] else ""
    if outcome["replaced"]:
        print(f"{outcome['replaced']} sounds with other settings were replaced", file=sys.stderr)
    if outcome["interrupted"]:
        print(f"interrupted; {done} of {points} done; run the same command to continue", file=sys.stderr)
        return
    if outcome["gone"]:
        print(
            f"{outcome['gone']} sounds have been removed since; run the same command to render them again",
            file=sys.stderr,
        )
    if failed:
        print(f"{failed} of {points} failed; see the column status of {outcome['index']}", file=sys.stderr)
    gain = f", all at {outcome['gain_db']:+.1f} dB" if "gain_db" in outcome else ""
    print(f"{done} of {points} done{before}{gain}\n{outcome['index']}")
    for file in ("sfz", "sheet"):
        if file in outcome:
            print(outcome[file])
