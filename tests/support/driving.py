"""A mission without a scenario, for tests and benchmarks."""

from collections.abc import Sequence

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.loop.drive import Ending, Watch, Watched, recording_of
from vastflow.sim.loop.simulation import told
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Recording
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator import state
from vastflow.sim.nav2.navigator.prepared import PreparedMap
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.robot_model import Lidar, Robot


def drive(
    prepared: PreparedMap,
    parameters: NavParameters,
    lidar: Lidar,
    robot: Robot,
    start: Pose,
    mission: Mission,
    obstacles: tuple[Obstacle, ...],
    entropy: Sequence[int],
    timeout_s: float,
    watch: Watch | None = None,
    watch_ticks: Sequence[int] = (),
) -> Recording:
    """Drive one mission to its end; for the arguments see `ClosedLoop` and `vastflow.sim.run.run`."""
    loop = ClosedLoop(prepared, parameters, lidar, robot, start, obstacles, entropy, timeout_s)
    loop.localize(start)
    loop.navigate(mission)
    Watched(loop, watch, watch_ticks).advance(loop.last_tick)
    if loop.status == state.RUNNING:
        ending = Ending("timed_out", "the mission did not end within its time")
    elif loop.status == state.SUCCEEDED:
        ending = Ending("succeeded")
    else:
        ending = Ending("aborted", told(loop), loop.error_code)
    return recording_of(loop, entropy, ending)
