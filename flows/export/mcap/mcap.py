"""The format `mcap`: each run as a bag of ROS 2 for Foxglove, RViz, and `ros2 bag`."""

import csv
import io
from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.flows.export.format import ExportedCampaign, ExportedFile, Format
from vastflow.flows.export.mcap.bag import NAME
from vastflow.flows.export.mcap.layout import NAME as LAYOUT
from vastflow.flows.export.mcap.layout import layout
from vastflow.flows.export.mcap.messages import WARN, RunBag
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import signals_of
from vastflow.oracles.replay.recorded import RecordedRun
from vastflow.sim.model.nodes import MESSAGES
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.replay import Box, State, first_difference, moment_of, published_by, snapshot_of
from vastflow.sim.run import run
from vastflow.sim.scenario.programs.actions import PROCESSES
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import world_of
from vastflow.sim.world.robot_model import Lidar

SNAPSHOT_TICKS: Final = 5
"""Ticks between two messages of paths and particles: 4 Hz."""
LOCAL_TICKS, GLOBAL_TICKS = 10, 20
"""Ticks between two local costmaps (2 Hz), and two global ones (1 Hz), as in Nav2's own parameter file."""
_WHOLE: Final = Box(-1e9, -1e9, 1e9, 1e9)
_NOTHING: Final = Box(0.0, 0.0, 0.0, 0.0)
_NO_POSE: Final = Pose(0.0, 0.0)


class Mcap(Format):
    """A bag for each run, and a layout for Foxglove.

    What was not recorded, such as scans and costmaps, comes from executing the run again. A run with programs is not executed:
    its bag has the recorded part, as that of a run that comes out otherwise here has.
    """

    executes = True

    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield the layout and the bags."""
        yield LAYOUT, layout()
        for each in campaign.configurations:
            for exported in each.runs:
                if exported.recorded and exported.read is not None:
                    for name, content in bag_of(exported.read(), outputs=exported.outputs).items():
                        yield f"{each.name}/{exported.run_index}/{NAME}/{name}", content


def bag_of(
    recorded: RecordedRun, without: Collection[str] = (), outputs: Mapping[str, bytes] = MappingProxyType({})
) -> dict[str, bytes]:
    """Return the files of a run's bag by their names.

    Args:
        without: Topics that are left out.
        outputs: Files of its programs, of which messages of nodes are told in place of what this version knows of their topics.

    Raises:
        ValueError: the recorded messages are damaged.
        UserError: the extra `ros` is not installed.
    """
    scenario, recording = recorded.scenario, recorded.recording
    situation, world = situation_of(scenario), world_of(scenario.environment)
    lidar = system_of(scenario.system, is_drawn=True).lidar
    published = []
    if scenario.programs is not None and scenario.programs.nodes is not None:
        published = _messages(outputs)
        without = {*without, "/cmd_vel_nav", *(topic for _, topic, *_ in published)}  # there is no controller of ours
    told = RunBag(without)
    missing = _execute(told, recorded, lidar)
    if missing:
        told = RunBag(without)  # without what another run saw
        told.says(0, missing, WARN)
    _tell_rows(told, recording.columns, with_frames=bool(missing), with_truth=not recording.run.estimated_by)
    told.begins(world.map if world else None, lidar, situation.start)
    tracks = obstacle_tracks_of(situation, recording.run, signals_of(recording.columns))
    told.surroundings(tracks, recording.run.events, int(recording.columns["t_ms"][-1]))
    unknown = {f"{each[1]} ({each[2]})" for each in published if not told.add_recorded(*each[1:3], each[0], each[3])}
    if unknown:
        told.says(0, left_out := f"no definition is known of {', '.join(sorted(unknown))}", WARN)
        missing += f"; {left_out}"
    about = {
        "campaign": str(recorded.metadata["name"]),
        "run": f"{recorded.configuration}/{recording.run.run_index}",
        "outcome": recording.run.outcome,
        "reason": recording.run.reason,
        "judgment": recorded.judgment,
        "vastflow": str(recorded.metadata["vastflow"]),
        "executed_again": missing or "equal to the recording bit for bit",
    }
    return told.files(about)


def _messages(outputs: Mapping[str, bytes]) -> list[tuple[int, str, str, bytes]]:
    """Return time (ns), topic, type, and content of each message that nodes published."""
    content = io.BytesIO(outputs.get(f"{MESSAGES}/messages.cdr", b""))
    lines = outputs.get(f"{MESSAGES}/messages.csv", b"").decode().splitlines()[1:]
    return [(int(t_ns), topic, kind, content.read(int(size))) for t_ns, topic, kind, size in csv.reader(lines)]


def _execute(told: RunBag, recorded: RecordedRun, lidar: Lidar) -> str:
    """Execute a run, tell what its stack publishes, and return why the recorded part alone can be told."""
    checked = checked_of(recorded.scenario)
    if checked.programs is not None or not checked.actions.isdisjoint(PROCESSES):
        return "only what was recorded: the run has programs, and is not executed for an export"

    def watch(stack: State, tick: int) -> None:
        moment, published = moment_of(stack, tick), published_by(stack, tick)
        told.sensed(moment, published, lidar)
        told.doing(moment)
        if tick % SNAPSHOT_TICKS == 0:
            is_whole = tick % GLOBAL_TICKS == 0
            snapshot = snapshot_of(stack, moment, _WHOLE if is_whole else _NOTHING, overview=False)
            told.seen(snapshot, published, has_local=tick % LOCAL_TICKS == 0, has_global=is_whole)

    try:
        index = recorded.recording.run.run_index
        executed = run(
            recorded.scenario, index, recorded.seed, watch, range(round(recorded.scenario.timeout_s / TICK_S))
        )
    except ValueError as error:  # a scenario of another version, or an imported run
        return f"only what was recorded: the run can't be executed here: {error}"
    difference = first_difference(recorded.recording, executed)
    return "" if difference is None else f"only what was recorded: executed here, the run differs: {difference}"


def _tell_rows(told: RunBag, columns: Mapping[str, NDArray[np.int32]], *, with_frames: bool, with_truth: bool) -> None:
    """Tell what was recorded, of an imported run with fewer columns.

    Args:
        with_frames: Tell frames that have the estimate as odometry, where that was not recorded.
        with_truth: False where the recorded pose is the estimate itself.
    """
    rows = signals_of(columns)
    names = ("t_s", "x_m", "y_m", "yaw_rad", "estimated_x_m", "estimated_y_m", "estimated_yaw_rad", "localized")
    still = np.zeros(len(rows["t_s"]))
    spreads = (rows.get(f"covariance_{name}", still) for name in ("xx_m2", "xy_m2", "yy_m2", "yaw_rad2"))
    covariances = np.column_stack([*spreads])
    motions = {
        topic: np.column_stack(
            [rows[f"{of}speed_mps"], rows.get(f"{of}lateral_speed_mps", still), rows[f"{of}yaw_rate_radps"]]
        )
        for topic, of in (("", ""), ("/cmd_vel_nav", "command_"), ("/cmd_vel", "sent_"))
        if f"{of}speed_mps" in rows
    }
    own = motions.pop("")
    for k, row in enumerate(zip(*(rows[name].tolist() for name in names), strict=True)):
        t_s, true, estimate, is_new = row[0], Pose(*row[1:4]), Pose(*row[4:7]), row[7]
        if with_frames:
            told.frames(t_s, _NO_POSE, estimate, true if with_truth else None)
        if with_truth:
            told.truth(t_s, true, *own[k].tolist())
        for topic, motion in motions.items():
            told.commanded(t_s, topic, *motion[k].tolist())
        if is_new:
            told.localized(t_s, estimate, covariances[k])
