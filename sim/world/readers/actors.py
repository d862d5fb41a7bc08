"""People whom a Gazebo world animates, which are no bodies of it."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from vastflow.sim.model.elementary import dist
from vastflow.sim.model.files import read_bytes, xml_root
from vastflow.sim.world.readers.sdf import Sdf

WALKER_M: Final = 0.25
"""Radius of a person; its skin has no shape that stands."""


def actor_names(file: Path) -> list[str]:
    """Return the names of the people who walk in a world that was read; none in other kinds of worlds."""
    actors = xml_root(read_bytes(file)).iter("actor") if file.suffix in Sdf.suffixes else ()
    return [actor.get("name") or "actor" for actor in actors if actor.find(".//waypoint") is not None]


def walkers(file: Path) -> Iterator[dict[str, Any]]:
    """Yield a world's animated people as movers of one speed, with rounds as long as in Gazebo.

    Raises:
        ValueError: waypoints without poses in time.
    """
    for actor in xml_root(read_bytes(file)).iter("actor"):
        name = actor.get("name") or "actor"
        waypoints = list(actor.iter("waypoint"))
        times_s = [float(each.findtext("time") or "nan") for each in waypoints]
        points_m = [tuple(map(float, (each.findtext("pose") or "").split()[:2])) for each in waypoints]
        route = [at for k, at in enumerate(points_m) if k == 0 or at != points_m[k - 1]]
        if len(route) < 2:
            continue  # it stands, and has no collision
        if any(len(at) != 2 for at in route) or not times_s[-1] > times_s[0]:
            raise ValueError(f"{name}: expected waypoints with a pose and a later time each")
        length_m = math.fsum(dist(a, b) for a, b in zip(route, [*route[1:], route[0]], strict=True))
        yield {
            "name": name,
            "shape": {"radius_m": WALKER_M},
            "waypoints": [list(at) for at in route],
            "speed_m_s": round(length_m / (times_s[-1] - times_s[0]), 3),
            "loop": "around",
        }
