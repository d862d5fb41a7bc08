"""Start, goals, and path of a configuration: their keys, and given values."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field

from vastflow.sim.model.digest import Value
from vastflow.sim.model.pose import Pose, pose_of, written_pose_of

START_KEY: Final = "start_pose"
GOAL_KEY: Final = "goal_pose"
GOALS_KEY: Final = "goal_poses"
PATH_KEY: Final = "_path"
PATH_LENGTH_KEY: Final = "_path_length"


def _goals(value: Any) -> Any:
    if isinstance(value, str):
        return _key(value)
    if isinstance(value, dict):
        return (written_pose_of(value),)
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"expected a key such as '@goal_poses', or a list of poses, got {value!r}")
    return tuple(_pose(item) for item in value)


def _key(value: str) -> str:
    key = value.removeprefix("@")
    if not key or key.startswith("_"):
        raise ValueError(f"expected the name of a parameter, such as '@start_pose', got {value!r}")
    return key


def _pose(value: Any) -> Pose:
    return value if isinstance(value, Pose) else written_pose_of(value)


KeyParameter: TypeAlias = Annotated[str, Field(min_length=1), AfterValidator(_key)]
"""`@key` or key of a value that a producer writes (without the @ once read)."""
StartParameter: TypeAlias = Annotated[
    str | Pose,
    BeforeValidator(
        lambda value: _key(value) if isinstance(value, str) else _pose(value),
        json_schema_input_type=str | dict[str, Any],
    ),
]
"""`@key` of the configuration's key that holds the start (without the @ once read), or the pose itself."""
GoalsParameter: TypeAlias = Annotated[
    str | tuple[Pose, ...],
    BeforeValidator(_goals, json_schema_input_type=str | list[dict[str, Any]] | dict[str, Any]),
]
"""`@key` of the configuration's key that holds the goals (without the @ once read), or the pose or poses themselves."""


def start_key(parameter: str | Pose) -> str:
    return parameter if isinstance(parameter, str) else START_KEY


def goals_key(parameter: str | tuple[Pose, ...]) -> str:
    """The key that holds the goals; `goal_pose` holds one pose, any other key a list."""
    return parameter if isinstance(parameter, str) else GOALS_KEY


def given_start(inputs: Mapping[str, Value], parameter: str | Pose) -> Pose | None:
    """The given start, or None.

    Raises:
        ValueError: what is there is no pose.
    """
    if isinstance(parameter, Pose):
        return parameter
    return pose_of(inputs[parameter], parameter) if parameter in inputs else None


def given_goals(inputs: Mapping[str, Value], parameter: str | tuple[Pose, ...]) -> tuple[Pose, ...]:
    """The given goals in order; may be empty.

    Raises:
        ValueError: what is there is no pose, or no list of poses.
    """
    if isinstance(parameter, tuple):
        return parameter
    if parameter not in inputs:
        return ()
    value = inputs[parameter]
    if isinstance(value, Mapping):
        return (pose_of(value, parameter),)
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise ValueError(f"{parameter}: expected a list of poses, got {value!r}")
    return tuple(pose_of(item, f"{parameter}[{i}]") for i, item in enumerate(value))
