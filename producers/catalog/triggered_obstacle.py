"""The producer of an obstacle that appears on a configuration's path when the robot comes near."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.catalog.obstacle import (
    ObstacleConfig,
    ObstacleParameters,
    Placement,
    asked_for,
    combinations,
    placed,
)
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.numbers import NotNegatives, Positives
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.ground import map_needed
from vastflow.producers.places.placement import Site
from vastflow.producers.places.site import SiteRequest
from vastflow.producers.places.stops import GOAL_KEY, START_KEY, GoalsParameter, KeyParameter, StartParameter
from vastflow.sim.model.digest import Value
from vastflow.sim.model.pose import pose_of
from vastflow.sim.model.scenario import Dimension


class TriggeredObstacleParameters(ObstacleParameters):
    """Of `ObstacleVariationWithDistanceTrigger`: those of `ObstacleVariation`, for one obstacle, and its trigger."""

    spawn_trigger_point: KeyParameter
    """Key of the point that triggers the obstacle: the obstacle's own place."""
    spawn_trigger_threshold: KeyParameter
    """Key of the distance (m) from that point at which the robot triggers the obstacle."""
    trigger_distance: Positives
    """That distance (m); one value or several."""
    spawn_delay_s: NotNegatives = (0.0,)
    """Time from the trigger until the obstacle appears (s), as a simulator needs to spawn it; one value or several."""
    start_pose: StartParameter = START_KEY
    """Key of the path's start, or the start itself: `{x, y, yaw}` in meters and radians."""
    goal_pose: GoalsParameter = GOAL_KEY
    """Key of the path's goal, or the goal itself."""

    @property
    def delay_key(self) -> str:
        """Key of the delay (s), written where any delay is greater than 0."""
        return f"{self.name}_delay_s"

    @property
    def trigger_keys(self) -> tuple[str, ...]:
        """Keys of what triggers the obstacle."""
        delay = (self.delay_key,) if any(self.spawn_delay_s) else ()
        return (self.spawn_trigger_point, self.spawn_trigger_threshold, *delay)

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        keys = [self.name, *self.trigger_keys]
        if len(set(keys)) < len(keys):
            raise PydanticCustomError("keys", "expected three, got one key twice in {keys}", {"keys": ", ".join(keys)})
        amounts = [config.amount for config in self.obstacle_configs]
        total = sum(amount or 0 for amount in amounts)
        if total > 1 or (total < 1 and None not in amounts):
            raise PydanticCustomError("amount", "expected one for one trigger, got {total} obstacles", {"total": total})
        return self


class ObstacleVariationWithDistanceTrigger(Producer[TriggeredObstacleParameters]):
    """An obstacle near the path that appears when the robot comes within a distance of its place.

    It is placed like those of `ObstacleVariation`, as if it stood from the beginning, anywhere along the path that is
    farther from the start than the trigger's distance: along the path and in a straight line, so that it is not there when
    the robot sets out. As version 1 places it, along the path counts.
    """

    Parameters = TriggeredObstacleParameters

    @property
    def reads(self) -> tuple[str, ...]:
        """What `ObstacleVariation` reads, and whether the trigger's keys are free."""
        asked = self.parameters
        return (*self._request.reads, asked.spawn_trigger_point, asked.spawn_trigger_threshold)

    @property
    def needs(self) -> tuple[str, ...]:
        """The map, unless the parameters name a file."""
        return map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The list with the obstacle, its trigger's point and distance, and its delay where there is any."""
        asked = self.parameters
        return dict.fromkeys((asked.name, *asked.trigger_keys), asked.dimension or "environment")

    @property
    def most_choices(self) -> int:
        """A placement for each trigger distance, each combination and each of `count`, with each delay."""
        return (
            len(self.parameters.trigger_distance)
            * len(self.parameters.spawn_delay_s)
            * self.parameters.count
            * math.prod(config.n_choices for config in self.parameters.obstacle_configs)
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """As those of `ObstacleVariation`."""
        return self.parameters.remarks

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `count` placements of each combination of each trigger distance, the distances outermost, each with every delay.

        A placement depends on the seed, what is read, its distance, its combination and its number among equals. Delays share it.
        """
        asked = self.parameters
        site = self._site(inputs)
        for distance_m in asked.trigger_distance:
            for kinds in combinations(asked.obstacle_configs):
                for number in range(1, asked.count + 1):
                    requested: dict[str, Value] = {
                        "trigger_distance": distance_m,
                        "obstacle_configs": [kind.requested() for kind in kinds],
                        "placement": number,
                    }
                    there = site if isinstance(site, str) else _from(asked.placement, site, kinds, distance_m)
                    entries = (
                        there if isinstance(there, str) else placed(asked.placement, there, kinds, draws, requested)
                    )
                    if isinstance(site, str) or isinstance(entries, str):
                        yield Rejection(str(entries), requested)
                    else:
                        for delay_s in asked.spawn_delay_s:
                            listed = {
                                "trigger_distance": distance_m,
                                "spawn_delay_s": delay_s,
                                **asked_for(kinds, number),
                            }
                            yield Fragment(self._values(inputs, site, entries[0], listed))

    def _site(self, inputs: Mapping[str, Value]) -> Site | str:
        asked = self.parameters
        for key in (asked.spawn_trigger_point, asked.spawn_trigger_threshold):
            if key in inputs:
                return f"{key} is written already, for another trigger; a key of its own for this one"
        return self._request.site(inputs)

    def _values(
        self, inputs: Mapping[str, Value], site: Site, entry: dict[str, Value], listed: Mapping[str, Value]
    ) -> dict[str, Value]:
        asked = self.parameters
        trigger: dict[str, Value] = {"point": asked.spawn_trigger_point, "threshold": asked.spawn_trigger_threshold}
        delay: dict[str, Value] = {}
        if any(asked.spawn_delay_s):
            trigger["delay"], delay[asked.delay_key] = asked.delay_key, listed["spawn_delay_s"]
        place = pose_of(entry["spawn_pose"])
        return {
            **self._request.written(inputs, site, [{**entry, "spawn_trigger": trigger}], listed),
            asked.spawn_trigger_point: {"x": place.x_m, "y": place.y_m, "z": 0.0},
            asked.spawn_trigger_threshold: listed["trigger_distance"],
            **delay,
        }

    @property
    def _request(self) -> SiteRequest:
        asked = self.parameters
        return SiteRequest(asked.name, asked.map_file, asked.robot_diameter, asked.start_pose, asked.goal_pose)


def _from(placement: Placement, site: Site, kinds: tuple[ObstacleConfig, ...], distance_m: float) -> Site | str:
    """The site beyond the trigger's distance from the start; or why nothing can be triggered there.

    Version 1 asks for that distance along the path alone: its obstacle may be there when the robot sets out.
    """
    wanted = [kind.wanted(site.length_m) for kind in kinds]
    total = sum(each.amount for each in wanted)
    if total != 1:
        return f"{total} obstacles were asked for on a path of {site.length_m:.2f} m; one for one trigger"
    (pattern,) = [each.pattern for each in wanted if each.amount]
    least_m = pattern.circumradius_m + site.ground.robot_diameter_m / 2
    if distance_m < least_m and placement == "constructive":
        return (
            f"at {distance_m:g} m the obstacle would appear where the robot is; a trigger_distance of {least_m:.2f} m"
        )
    rest = beyond(site.path_xy_m, distance_m)
    if not len(rest):
        return f"the path of {site.length_m:.2f} m ends before {distance_m:g} m, where the trigger could be set off"
    return replace(site, path_xy_m=rest, from_start_m=distance_m if placement == "constructive" else 0.0)


def beyond(path_xy_m: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
    """The rest (M, 2) of a polyline (N, 2) from `distance_m` along it; empty where it is shorter."""
    along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path_xy_m, axis=0).T))))
    if along_m[-1] < distance_m:
        return np.empty((0, 2))
    cut = [np.interp(distance_m, along_m, axis) for axis in path_xy_m.T]
    return np.vstack((cut, path_xy_m[along_m > distance_m]))
