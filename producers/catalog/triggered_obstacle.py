"""The producer of an obstacle that appears on a configuration's path when the robot comes near."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from vastflow.producers.catalog.obstacle import ObstacleConfig, ObstacleParameters, ObstacleProducer
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.numbers import NotNegatives, Positives
from vastflow.producers.places.placement import Line, Site
from vastflow.producers.places.stops import GOAL_KEY, START_KEY, GoalsParameter, KeyParameter, StartParameter
from vastflow.sim.model.digest import Value
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Dimension


class TriggeredObstacleParameters(ObstacleParameters):
    """Parameters of `ObstacleVariationWithDistanceTrigger`: `ObstacleVariation`'s and the trigger."""

    spawn_trigger_point: KeyParameter
    """Key of the point that triggers the obstacle: the obstacle's own place."""
    spawn_trigger_threshold: KeyParameter
    """Key of the distance (m) from that point at which the robot triggers the obstacle."""
    trigger_distance: Positives
    """The distance of the trigger (m); one value or several."""
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
        delay = (self.delay_key,) if any(self.spawn_delay_s) else ()
        return (self.spawn_trigger_point, self.spawn_trigger_threshold, *delay)

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        keys = [self.name, *self.trigger_keys]
        if len(set(keys)) < len(keys):
            raise ValueError(f"expected three different keys, got {', '.join(keys)}")
        amounts = [config.amount for config in self.obstacle_configs]
        total = sum(amount or 0 for amount in amounts)
        if total > 1 or (total < 1 and None not in amounts):
            raise ValueError(f"expected one obstacle for one trigger, got {total}")
        return self


class ObstacleVariationWithDistanceTrigger(ObstacleProducer[TriggeredObstacleParameters]):
    """An obstacle near the path that appears when the robot comes within a distance of its place.

    It is placed like those of `ObstacleVariation`, as if it stood from the beginning, anywhere along the path that is
    farther from the start than the trigger's distance: along the path and in a straight line, so that it is not there when
    the robot sets out. As version 1 places it, along the path counts. Each placement comes with every delay.
    """

    Parameters = TriggeredObstacleParameters

    @property
    def reads(self) -> tuple[str, ...]:
        return (*super().reads, self.parameters.spawn_trigger_point, self.parameters.spawn_trigger_threshold)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        asked = self.parameters
        return dict.fromkeys((asked.name, *asked.trigger_keys), asked.dimension or "environment")

    @property
    def most_choices(self) -> int:
        return len(self.parameters.trigger_distance) * len(self.parameters.spawn_delay_s) * super().most_choices

    @property
    def _given(self) -> Sequence[Mapping[str, Any]]:
        return [{"trigger_distance": distance_m} for distance_m in self.parameters.trigger_distance]

    @property
    def _stops(self) -> tuple[str | Pose, str | tuple[Pose, ...]]:
        return self.parameters.start_pose, self.parameters.goal_pose

    def _site(self, inputs: Mapping[str, Value]) -> Site | str:
        asked = self.parameters
        for key in (asked.spawn_trigger_point, asked.spawn_trigger_threshold):
            if key in inputs:
                return f"{key} is written already, for another trigger. Give this one a key of its own."
        return super()._site(inputs)

    def _part(self, site: Site, kinds: Sequence[ObstacleConfig], given: Mapping[str, Any]) -> Site | str:
        """Return the site beyond the trigger's distance from the start; or why nothing can be triggered there.

        Version 1 asks for that distance along the path alone: its obstacle may be there when the robot sets out.
        """
        distance_m, constructive = given["trigger_distance"], self.parameters.placement == "constructive"
        wanted = [kind.wanted(site.length_m) for kind in kinds]
        total = sum(each.amount for each in wanted)
        if total != 1:
            return f"{total} obstacles were asked for on a path of {site.length_m:.2f} m, and one trigger needs one"
        (pattern,) = [each.pattern for each in wanted if each.amount]
        least_m = pattern.shape.circumradius_m + site.ground.robot_diameter_m / 2
        if distance_m < least_m and constructive:
            return f"at {distance_m:g} m the obstacle would appear where the robot is. Expected a trigger_distance of {least_m:.2f} m"
        rest = beyond(site.path_xy_m, distance_m)
        if not len(rest):
            return f"the path of {site.length_m:.2f} m ends before {distance_m:g} m, where the trigger could be set off"
        return replace(site, path_xy_m=rest, from_start_m=distance_m if constructive else 0.0)

    def _fragments(
        self,
        inputs: Mapping[str, Value],
        site: Site,
        entries: Sequence[Mapping[str, Value]],
        given: Mapping[str, Any],
        asked: Mapping[str, Value],
    ) -> Iterator[Fragment]:
        point, threshold = self.parameters.spawn_trigger_point, self.parameters.spawn_trigger_threshold
        trigger: dict[str, Value] = {"point": point, "threshold": threshold}
        place = pose_of(entries[0]["spawn_pose"])
        written = {point: {"x": place.x_m, "y": place.y_m, "z": 0.0}, threshold: given["trigger_distance"]}
        for delay_s in self.parameters.spawn_delay_s:
            if any(self.parameters.spawn_delay_s):
                trigger["delay"], written[self.parameters.delay_key] = self.parameters.delay_key, delay_s
            entry = {**entries[0], "spawn_trigger": dict(trigger)}
            requested = {**given, "spawn_delay_s": delay_s, **asked}
            for fragment in super()._fragments(inputs, site, [entry], given, requested):
                yield Fragment({**fragment.values, **written})


def beyond(path_xy_m: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
    """The rest (M, 2) of a polyline (N, 2) from `distance_m` along it; empty where it is shorter."""
    along_m = Line.along(path_xy_m).along_m
    if along_m[-1] < distance_m:
        return np.empty((0, 2))
    cut = [np.interp(distance_m, along_m, axis) for axis in path_xy_m.T]
    return np.vstack((cut, path_xy_m[along_m > distance_m]))
