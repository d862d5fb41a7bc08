"""Oracle `social`: distances from bodies that move, and who moved into whom."""

import math
from collections.abc import Mapping
from typing import ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.observe import PERSONAL_M
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.model.elementary import hypot

INTIMATE_M: Final = 0.45
"""Outer end of the intimate distance of people (Hall, The Hidden Dimension, 1966)."""
APPROACHES_MPS: Final = 0.05
"""Speed toward another above which a party of a contact moved into it."""
AGAIN_S: Final = 0.5
"""Time from one touch of a body to the next below which they are one contact: what is pushed lets go and touches again."""
BOTH, ROBOT, BODY = "both", "the robot", "the body"


def mover_of(track: ObstacleTrack, trace: Trace, contact_s: float) -> str:
    """Return which party of a contact moved into the other: `ROBOT`, `BODY`, `BOTH`, or the empty text.

    Velocities are those up to the last row before the contact, along the line of centers.
    """
    t_ms = np.rint(trace["t_s"] * 1000.0).astype(np.int32)
    row = min(max(int(np.searchsorted(t_ms, contact_s * 1000.0 + 0.5)) - 1, 1), len(t_ms) - 1)
    rows = slice(row - 1, row + 1)
    step_s = float(np.diff(t_ms[rows])[0]) * 1e-3
    body_m, robot_m = track.at(t_ms[rows]), trace.xy_m[rows]
    x_m, y_m = (body_m[-1] - robot_m[-1]).tolist()
    steps_m = (np.diff(at_m, axis=0)[0].tolist() for at_m in (robot_m, body_m))
    along_mps = [(dx_m * x_m + dy_m * y_m) / (hypot(x_m, y_m) or 1.0) / step_s for dx_m, dy_m in steps_m]
    robot, body = along_mps[0] > APPROACHES_MPS, -along_mps[1] > APPROACHES_MPS
    return (BOTH if body else ROBOT) if robot else BODY if body else ""


class SocialParameters(Parameters):
    """Parameters of `social`.

    Attributes:
        fail_on_contact: Contacts that fail a run: `none`, those in which the `robot` moved into the body, or `any`.
        most_intimate_share: Greatest share of a run's time closer than 0.45 m.
    """

    fail_on_contact: Literal["none", "robot", "any"] = "any"
    most_intimate_share: float = Field(default=1.0, ge=0, le=1)


class Social(Oracle[SocialParameters]):
    """Fails where the robot touches a body that moves, or is close to one for too long.

    Distances are those from the rim of the robot's circumscribed disc to the outline of the nearest mover, row by row. A party of a contact moved into
    the other if it approached at more than 0.05 m/s up to the last row before; both may, or neither. A run without movers passes.

    Touches of one body that follow each other within 0.5 s are one contact, told by the first.

    Metrics: `smallest_distance` (m), negative where the disc overlaps a mover; `intimate_share` and `personal_share` (1), shares of the run's time closer than
    0.45 m and 1.2 m, Hall's intimate and personal distance; `smallest_time_to_collision` (s), while nothing touched, see
    `vastflow.oracles.observation.observe.encounters`; `contacts` with movers, and of these `contacts_by_robot`, `contacts_by_body`, and
    `contacts_by_both` (1). Without movers there are none.
    """

    Parameters = SocialParameters
    metrics: ClassVar[Mapping[str, str]] = {
        "smallest_distance": "m",
        "intimate_share": "1",
        "personal_share": "1",
        "smallest_time_to_collision": "s",
        **dict.fromkeys(("contacts", "contacts_by_robot", "contacts_by_body", "contacts_by_both"), "1"),
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        if not situation.movers:
            return self.passed(trace)
        tracks = {
            each.obstacle.name: each for each in obstacle_tracks_of(situation, trace.run, trace.columns) if each.moves
        }
        if len(trace) < 2 or not tracks:
            return self.not_judged(trace, "the recording has no two rows with movers")
        distance_m = trace["moving_clearance_m"] - situation.circumscribed_radius_m
        # Each row stands for half the steps on either side.
        steps_s = np.diff(trace["t_s"], prepend=trace["t_s"][0], append=trace["t_s"][-1])
        weights = (steps_s[:-1] + steps_s[1:]) / (2 * (trace["t_s"][-1] - trace["t_s"][0]))
        intimate, personal = (float(weights[distance_m < near_m].sum()) for near_m in (INTIMATE_M, PERSONAL_M))
        contacts, last_s = [], dict.fromkeys(tracks, -math.inf)
        for event in trace.events("contact"):
            if event.what in tracks:
                if event.t_s - last_s[event.what] >= AGAIN_S:
                    contacts.append((event, mover_of(tracks[event.what], trace, event.t_s)))
                last_s[event.what] = event.t_s
        by = [who for _, who in contacts]
        soonest_s = trace["time_to_collision_s"][trace["time_to_collision_s"] > 0.0]
        metrics: dict[str, float | None] = {
            "smallest_distance": round(float(distance_m.min()), 9),
            "intimate_share": round(intimate, 6),
            "personal_share": round(personal, 6),
            "smallest_time_to_collision": float(soonest_s.min()) if np.isfinite(soonest_s).any() else None,
            "contacts": len(contacts),
            "contacts_by_robot": by.count(ROBOT),
            "contacts_by_body": by.count(BODY),
            "contacts_by_both": by.count(BOTH),
        }
        fails = {"none": (), "robot": (ROBOT, BOTH), "any": (ROBOT, BODY, BOTH, "")}[self.parameters.fail_on_contact]
        for event, who in contacts:
            if who in fails:
                moved = f"{who} moved into the other" if who in (ROBOT, BODY) else f"{who or 'neither'} moved"
                return self.failed(trace, f"touched {event.what!r} at {event.t_s:g} s, and {moved}", **metrics)
        if intimate > (most := self.parameters.most_intimate_share):
            reason = f"closer than {INTIMATE_M:g} m to a mover for {intimate:.1%} of the time, more than {most:.1%}"
            return self.failed(trace, reason, **metrics)
        return self.passed(trace, **metrics)
