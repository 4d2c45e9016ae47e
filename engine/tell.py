"""What a person reads of a render, of what was built, and of what accuracy costs."""

import math
import sys
from typing import Any

from engine.save import SILENCE, fitting

MOST_ISLANDS = 32  # listed
ENOUGH = 0.8  # of the cost that would just be in time


def summary(stats: dict[str, Any], beside: list[str]) -> None:
    """The summary a person reads, and the files written beside the sound."""
    rows = summed(stats) | ({"beside it": ", ".join(beside)} if beside else {})
    for name, value in rows.items():
        print(f"{name:<18} {value}")
    print(stats["output"])


def summed(stats: dict[str, Any]) -> dict[str, str]:
    """What a render was, in words."""
    newton, energy, activity = stats["newton"], stats["energy"], stats["activity"]
    peak, regimes = stats["peak"], newton["regimes"]
    level = f"{20 * math.log10(peak):.1f} dBFS" if peak > SILENCE else "silent"
    if stats.get("silent"):
        level = f"silent: {stats['silent']}"
    elif peak > 1.0:
        cut = f"{stats['clipped']} samples are clipped" if stats.get("clipped") else "players will clip it"
        level += f" (above full scale: {cut}; --gain {fitting(stats['gain_db'], peak):.1f} fits)"
    iterations = f"mean {newton['mean']:.2f}, p99 {newton['p99']}, max {newton['max']}; "
    iterations += ", ".join(f"{n}: {count}" for n, count in enumerate(newton["histogram"]) if count)
    samples = max(1, sum(regimes.values()))
    cores = f" on {stats['cores']} cores" if stats["cores"] > 1 else ""
    shares = ", ".join(f"{name.replace('_', ' ')} {n / samples:.2%}" for name, n in regimes.items() if n)
    rows = {
        "duration": f"{stats['seconds']:g} s at {stats['samplerate']} Hz, channels: {stats['channels']}",
        "peak": f"{level} (gain {stats['gain_db']:+.1f} dB on SI units)",
        "speed": f"{times(stats['real_time_factor'])} real time, {stats['ns_per_sample']:.1f} ns per sample{cores}",
        "Newton iterations": iterations if newton["solves"] else "none needed",
        "solved": shares or "no contacts",
        "energy error": f"{energy['error_max']:.1e} of the largest energy held,"
        f" {energy['error_per_step_max']:.1e} per step",
        "energy": f"{energy['initial']:.4g} J at first, {energy['supplied']:.4g} supplied,"
        f" {energy['dissipated']:.4g} dissipated, {energy['final']:.4g} left",
        "compiled in": ", ".join(stats["effects"]["compiled"]) or "none",
        "left out": ", ".join(stats["effects"]["left_out"]) or "none",
        "time": f"{activity['free']:.1%} free, {activity['contact']:.1%} in contact, {activity['asleep']:.1%} asleep",
    }
    if chosen := stats.get("chosen"):
        how = "the cheapest that does" if chosen["met"] else "NO SETTING DOES; this errs least"
        rows["error asked for"] = f"{chosen['asked']}: {chosen['setting']}, {how}"
        rows["error measured"] = (
            f"{chosen['error']:.1e} over the first {chosen['horizon'] * 1e3:.0f} ms, {chosen['bands_db']:.2f} dB of the"
            f" worst band, {chosen['ns_per_sample']:.0f} ns per sample"
        )
    if not stats["trusted"]:
        rows["NOT TO BE TRUSTED"] = "; ".join(stats["reasons"])
    if stats["real_time_factor"] < 1.0:
        rows["TOO SLOW"] = slow(stats)
    return rows


def times(factor: float) -> str:
    """A factor, such as 0.39 ×, 1.2 × or 120 ×."""
    return f"{factor:.2g} ×" if factor < 9.95 else f"{factor:.0f} ×"


def slow(stats: dict[str, Any]) -> str:
    """What makes a scene too slow for real time, and what would help: cost grows with the modes, and with the square
    of the points of contact (engine.layout)."""
    big, islands, factor = stats["islands"]["largest"], stats["islands"]["count"], stats["real_time_factor"]
    modes, contacts = big["modes"], big["contacts"]
    what = f"for real time: the island of {', '.join(big['bodies'][:4])}{' …' if len(big['bodies']) > 4 else ''} has"
    what += f" {modes} modes and {contacts} points of contact"
    what += f", the most of {islands} islands" if islands > 1 else ""
    goal = ENOUGH * factor
    if islands > 1:
        return f"{what}; as a whole it has to cost {goal:.2g} of what it does: --explain tells what each island costs"
    if modes * (1 + contacts / 4) >= contacts**2:
        return f"{what}; about {max(1, int(modes * goal))} modes would do"
    return f"{what}; about {max(1, int(contacts * math.sqrt(goal)))} points of contact would do"


def explained(found: dict[str, Any], seconds: float) -> None:
    """Islands, effects and costs (engine.explain)."""
    print(f"kernel {found['kernel']}; costs in ns per sample on one core, energies measured, over {seconds:g} s")
    columns(islands(found))
    if len(found["islands"]) > MOST_ISLANDS:
        print(f"… {len(found['islands'])} islands in all; --json lists every one")
    for name, what in found["effects"].items():
        print(f"{name:<24} {what}")
    for what in found["contacts_left_out"]:
        print(f"{'contact left out':<24} {what}")


def islands(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """A table of the first islands, its head first."""
    head = ("island", "modes", "dropped", "contacts", "solver", "expected", "mean", "busiest", "free/contact/asleep")
    rows: list[tuple[str, ...]] = [head]
    for island in found["islands"][:MOST_ISLANDS]:
        names = ", ".join(island["bodies"][:3]) + (" …" if len(island["bodies"]) > 3 else "")
        shares = "/".join(f"{island['activity'][s]:.0%}" for s in ("free", "contact", "asleep"))
        costs = tuple(f"{island[f'ns_{c}']:.0f}" for c in ("expected", "mean", "busiest"))
        counts = (str(island["modes"]), str(island["modes_dropped"]), str(island["contacts"]))
        rows.append((names, *counts, island["solver"], *costs, shares))
    return rows


def columns(rows: list[tuple[str, ...]]) -> None:
    """Rows of cells, as wide as they need."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def priced(found: dict[str, Any]) -> None:
    """Error against time, setting by setting (engine.price)."""
    print(against(found))
    columns(prices(found))
    print("* nothing else is both nearer and faster")
    print(found["verdict"])


def against(found: dict[str, Any]) -> str:
    """What the errors are taken from, and how far they can be believed."""
    return (
        f"error over the first {found['horizon'] * 1e3:.0f} ms against {found['reference']}, which is sure to"
        f" {found['disagreement']:.0e}; bands within {found['spread_db']:.2g} dB are chance"
    )


def prices(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """A table of settings and other methods, its head first. A star marks what nothing else beats in both."""
    head = "setting", "error", "bands", "decay", "pitch", "1st contact", "rebound", "impulse", "ns/sample", "real time"
    rows: list[tuple[str, ...]] = [("", *head, "Newton mean/p99/max", "energy error")]
    for row in found["rows"]:
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
                times(row["real_time_factor"]),
                f"{newton['mean']:.2f}/{newton['p99']}/{newton['max']}",
                f"{row['energy_error']:.0e}",
            )
        )
    for row in found["others"]:
        error = row["failed"] or f"{row['error']:.1e}"
        speed = times(1e9 / row["ns_per_sample"] / found["samplerate"])
        measured = (f"{row['ns_per_sample']:.0f}", speed, "", f"{row['energy_error']:.0e}")
        rows.append(("", row["setting"], error, *[""] * 6, *measured))
    return rows


def varied(told: dict[str, Any]) -> None:
    """How a sweep went, and where its sounds are."""
    done, points, failed = told["done"], told["points"], told["failed"]
    before = f", {told['before']} of them before" if told["before"] else ""
    if told["replaced"]:
        print(f"{told['replaced']} sounds of other settings were replaced", file=sys.stderr)
    if told["interrupted"]:
        print(f"interrupted; {done} of {points} done; run the same command to go on", file=sys.stderr)
        return
    if failed:
        print(f"{failed} of {points} failed; the column status of {told['index']} says why", file=sys.stderr)
    print(f"{done} of {points} done{before}\n{told['index']}")
