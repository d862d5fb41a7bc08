"""The nodes of a campaign file: `execution.nodes` and `execution.ros2`."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from vastflow.producers.campaign_file.containers import Command, Variables
from vastflow.producers.campaign_file.sections import EmptyIsMap, Section
from vastflow.producers.model.numbers import Positive
from vastflow.sim.model.faults import Got, Invalid
from vastflow.sim.model.nodes import ACTIONS, FRAMES, RECORDED, TOPICS, NodeProcess, Nodes


def _names(known: Mapping[str, str]) -> AfterValidator:
    def check(names: dict[str, str]) -> dict[str, str]:
        if unknown := next((name for name in names if name not in known), None):
            raise Invalid(Got(repr(unknown)), f"one of {', '.join(known)}")
        return names

    return AfterValidator(check)


class Ready(Section):
    """Sign that a process is ready, one of them."""

    topic: str | None = None
    """A topic that it publishes."""
    action: str | None = None
    """An action that it serves."""
    node: str | None = None
    """Name of a node."""
    log: str | None = None
    """Text of a line that it prints."""
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    """TCP port on which it listens."""
    within: Positive = 30.0
    """Seconds of the host's time."""


class NodeSpec(Section):
    """A process of a run, such as a node or a launch file."""

    command: Command
    """Program and arguments, a list or as a shell reads them; run files lie in its folder."""
    env: Variables = Field(default_factory=dict)
    """Its environment variables beside those of the run."""
    ready: Annotated[Ready, EmptyIsMap] = Field(default_factory=Ready)
    """What shows that it is ready; the next process starts then."""


class Joints(Section):
    """Joints of a differential drive, published on `/joint_states`."""

    left: str = "left_wheel_joint"
    """Name of the left wheel's joint."""
    right: str = "right_wheel_joint"
    """Name of the right wheel's joint."""
    wheel_radius: Positive
    """m"""
    track: Positive
    """Distance (m) between the wheels."""


class Ros2Spec(Section):
    """Meeting of the simulated robot and nodes of ROS 2: time, topics, frames, and missions."""

    python: str = "python3"
    """The Python that imports rclpy, after `execution.pre_command`."""
    time: Literal["lock_step", "paced"] = "lock_step"
    """Whether a tick waits for the answer to each scan, or for the host's clock."""
    answer: str = ""
    """Topic whose messages answer scans, in lock step; that of commands where empty."""
    answer_within: Positive = 10.0
    """Seconds of the host's time after which a missing answer breaks a run."""
    real_time_factor: Positive = 1.0
    """Simulated seconds in a second of the host, where time is paced."""
    most_late: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    """Share of paced ticks that may be late; a run with more is broken."""
    most_waiting: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    """Share of paced time for which a thread of the run may be ready and wait for a CPU; a run with more is broken."""
    mission: Literal["action", "topic"] = "action"
    """Whether missions are Nav2's actions, or goals on a topic."""
    goal_tolerance: Positive = 0.25
    """Distance (m) of the true pose from a goal on a topic that has reached it."""
    localization: Literal["nodes", "ideal"] = "nodes"
    """Who publishes the transform from the map to odometry: the nodes, or the bridge by the true pose."""
    stamped: bool = False
    """Whether commands are `TwistStamped`."""
    topics: Annotated[dict[str, str], _names(TOPICS), EmptyIsMap] = Field(default_factory=dict)
    """Topics that are called otherwise than in Nav2's bringup, by role."""
    frames: Annotated[dict[str, str], _names(FRAMES), EmptyIsMap] = Field(default_factory=dict)
    """Frames that are called otherwise than map, odom, base_link, and base_scan, by role: map, odom, base, laser."""
    actions: Annotated[dict[str, str], _names(ACTIONS), EmptyIsMap] = Field(default_factory=dict)
    """Actions that are called otherwise than in Nav2."""
    record: list[str] = Field(default_factory=lambda: [*RECORDED])
    """Topics of the nodes that are recorded."""
    joints: Joints | None = None
    """Wheels whose angles are published, which the simulated robot does not say."""


def nodes_of(specs: Sequence[Mapping[str, NodeSpec]], spec: Ros2Spec) -> Nodes:
    """Return the nodes of a campaign's runs."""
    processes = [_process(name, each) for entry in specs for name, each in entry.items()]
    given = spec.model_dump(
        exclude={"answer", "topics", "frames", "actions", "record", "answer_within", "goal_tolerance"}
    )
    topics = {**TOPICS, **spec.topics}
    return Nodes(
        **given,
        processes=tuple(processes),
        answer_within_s=spec.answer_within,
        goal_tolerance_m=spec.goal_tolerance,
        topics=topics,
        answer=spec.answer or topics["cmd_vel"],
        frames={**FRAMES, **spec.frames},
        actions={**ACTIONS, **spec.actions},
        record=tuple(spec.record),
    )


def _process(name: str, spec: NodeSpec) -> NodeProcess:
    kinds = ("topic", "action", "node", "log", "port")
    kind, at = next(((kind, str(at)) for kind in kinds if (at := getattr(spec.ready, kind)) is not None), ("", ""))
    return NodeProcess(name, tuple(spec.command), spec.env, kind, at, spec.ready.within)  # type: ignore[arg-type]
