# SPDX-License-Identifier: Apache-2.0
"""Rehearsed drives as a table, a line per world and fault, the ground of their places as another,
and what each place's stations are."""

from statistics import median
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_sim.robot.places.mapped import MappedPlace
from fcsv_sim.robot.rehearsal.free_ground import OBSTACLE_M, REACH_M, FreeGround
from fcsv_sim.robot.rehearsal.one_drive import ARRIVES, SAYS_NONE, DriveResult

_HEADS = (
    "world",
    "fault",
    "drives",
    "befell",
    "contacts",
    "arrived where the truth has a seen way",
    "others that arrived",
    '"no safe route" where there is none',
    "least room (m)",
    "time, median (s)",
    "place, rms (m)",
    "within 2 sigma",
    "reaction, worst (s)",
    "slowest step (s)",
)

_GROUND_HEADS = (
    "world",
    "places",
    f"of cells called free to {REACH_M:.0f} m: not free",
    f"of obstacles from {OBSTACLE_M:g} m on that a map knows: called free",
    "of truly free cells that a map knows: called free",
)


def table(results: Sequence[DriveResult]) -> List[str]:
    """Lines of the table. Reaction: simulated seconds from the picture that shows what is in the
    way to another route or to none; the slowest step of the guide is processor time."""
    groups: Dict[Tuple[str, str], List[DriveResult]] = {}
    for result in results:
        groups.setdefault((result.world, result.fault), []).append(result)
    rows = [_row(world, fault, of) for (world, fault), of in groups.items()]
    for world in dict.fromkeys(result.world for result in results):
        rows.append(_row(f"**{world}**", "all", [r for r in results if r.world == world]))
    return _lines(_HEADS, rows)


def ground_table(grounds: Sequence[FreeGround]) -> List[str]:
    """Lines of the table, a line for each world."""
    rows = []
    for world in dict.fromkeys(ground.world for ground in grounds):
        of = [ground for ground in grounds if ground.world == world]
        shares = (
            _share(of, "not_free", "called_free", 3),
            _share(of, "missed", "obstacles", 3),
            _share(of, "found", "free", 1),
        )
        rows.append((world, str(len(of)), *shares))
    return _lines(_GROUND_HEADS, rows)


def _share(grounds: Sequence[FreeGround], part: str, whole: str, digits: int) -> str:
    parts, wholes = (sum(getattr(ground, name) for ground in grounds) for name in (part, whole))
    return f"{parts / wholes:.{digits}%}" if wholes else "–"


def _lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> List[str]:
    return ["| " + " | ".join(cells) + " |" for cells in (heads, ["---"] * len(heads), *rows)]


def _row(world: str, fault: str, results: List[DriveResult]) -> List[str]:
    able = [r for r in results if r.expected == ARRIVES]
    none = [r for r in results if r.expected == SAYS_NONE]
    others = [r for r in results if r.expected not in (ARRIVES, SAYS_NONE)]
    arrived = [r for r in results if r.ended == "arrived"]
    reactions = [r.reaction_s for r in results if r.reaction_s is not None]
    drove = [r for r in results if r.way_m > 1.0] or results
    return [
        world,
        fault,
        str(len(results)),
        str(sum(r.befell for r in results)),
        str(sum(bool(r.contact) for r in results)),
        f"{sum(r.ended == 'arrived' for r in able)} of {len(able)}",
        f"{sum(r.ended == 'arrived' for r in others)} of {len(others)}",
        f"{sum(r.said_none and r.ended != 'arrived' for r in none)} of {len(none)}",
        f"{min(r.least_room_m for r in results):.2f}",
        f"{median(r.time_s for r in arrived):.0f}" if arrived else "–",
        f"{np.nanmean([r.place_rms_m for r in drove]):.2f}",
        f"{np.nanmean([r.honest for r in drove]):.0%}",
        f"{max(reactions):.1f}" if reactions else "–",
        f"{max(r.slowest_s for r in results):.2f}",
    ]


def stations_line(place: MappedPlace) -> str:
    """Where the vehicles looked from, and what they say of it."""
    told = ", ".join(
        f"({s.xyz_m[0]:.0f}, {s.xyz_m[1]:.0f}, {s.xyz_m[2]:.0f}) m {np.degrees(s.yaw_rad):.0f} deg"
        for s in place.looked.stations
    )
    return f"{place.name}: {len(place.looked.stations)} places to look from: {told}"


def verdict_line(results: Sequence[DriveResult]) -> str:
    """Says, in one sentence: whether a robot touched anything, what else must not be, and whether it
    arrived where it could."""
    broken = [r for r in results if r.broke]
    if not broken:
        able = [r for r in results if r.expected == ARRIVES]
        return (
            f"Verdict: nothing touched and nothing untrue said in {len(results)} drives; "
            f"{sum(r.ended == 'arrived' for r in able)} of {len(able)} arrived where the truth has a "
            "seen way"
        )
    contacts = sum(bool(r.contact) for r in broken)
    return f"Verdict: {len(broken)} of {len(results)} drives broke, {contacts} of them by a contact"
