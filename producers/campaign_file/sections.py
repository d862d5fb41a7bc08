"""Sections of a campaign file: what they are made of, designs of families, repetitions of runs, and the family's robot."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, Self, TypeAlias, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.model.faults import NOT_EXECUTED, Location, shown
from vastflow.producers.model.numbers import Count, Number, Seed
from vastflow.sim.model.faults import Fault, Got, Invalid
from vastflow.sim.system.robot import NOISE_PLACE, PRESETS, robot_keys
from vastflow.sim.world.robot_model import Drive


class Section(BaseModel):
    """A mapping of the campaign file with known keys; the text below a field is its description for editors."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


@dataclass(frozen=True, slots=True)
class Unexecuted:
    """Marks a field that this version does nothing with, and the consequence for the user, which may be empty."""

    consequence: str = ""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {**handler(schema), "$comment": NOT_EXECUTED}


EmptyIsList = BeforeValidator(lambda value: [] if value is None else value)
"""`variations:` with nothing below it is an empty list, as in YAML editors half-way through a file."""
EmptyIsMap = BeforeValidator(lambda value: {} if value is None else value)


def _single_key(value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not value:
        raise Invalid(Got(shown(value)), "'name: value'")
    if len(value) > 1:
        first, second, *_ = value
        right = f"indent it below {first!r}, or begin a new entry with '- '"
        said = Invalid(f"unexpected second key {second!r}", right)
        raise PydanticCustomError("second_key", "{error}", {"error": said, "key": second})
    return dict(value)


def _named(value: Any) -> dict[str, dict[str, Any]]:
    if isinstance(value, str):
        return {value: {}}
    ((name, parameters),) = _single_key(value).items()
    if parameters is not None and not isinstance(parameters, Mapping):
        said = Invalid(Got(shown(parameters)), "its parameters as a mapping")
        raise PydanticCustomError("parameters", "{error}", {"error": said, "at": name})
    return {name: dict(parameters or {})}


_SINGLE_KEY_SCHEMA = {"type": "object", "minProperties": 1, "maxProperties": 1}

SingleKeys: TypeAlias = Annotated[
    list[Annotated[dict[str, Any], PlainValidator(_single_key), WithJsonSchema(_SINGLE_KEY_SCHEMA)]], EmptyIsList
]
"""A list of `- name: value`."""
NamedSteps: TypeAlias = Annotated[
    list[
        Annotated[
            dict[str, dict[str, Any]],
            PlainValidator(_named),
            WithJsonSchema({"anyOf": [{"type": "string"}, _SINGLE_KEY_SCHEMA]}),
        ]
    ],
    EmptyIsList,
]
"""A list of `- name` or `- name: {parameters}`; always `{name: parameters}` once read."""
FreeForm: TypeAlias = Annotated[dict[str, Any], EmptyIsMap]
"""Any mapping."""

MOST_STRENGTH: Final = 6


class TWay(Section):
    """Every combination of the choices of any `strength` producers, in few configurations."""

    strength: Annotated[int, Field(ge=1, le=MOST_STRENGTH, strict=True)] = 2
    """Number of producers whose choices are combined in all ways."""


class Sample(Section):
    """A number of combinations, spread over all of them."""

    method: Literal["lhs", "sobol", "random"]
    """`lhs`: Latin hypercube, every choice of a producer about equally often; `sobol`: scrambled Sobol sequence;
    `random`: independently of each other."""
    size: Count
    """Number of configurations."""
    seed: Seed = 0
    """Seed of the sample."""


def _named_kind(value: Any) -> Any:
    if value is None or value == "cartesian":
        return {"cartesian": {}}
    if type(value) is str:
        right = "cartesian, 't_way: {strength: 2}' or 'sample: {method: lhs, size: 100}'"
        raise Invalid(Got(shown(value)), right)
    if isinstance(value, dict):
        return {key: {} if item is None else item for key, item in value.items()}
    return value


class DesignSpec(Section):
    """The combinations that become configurations: one of these."""

    cartesian: Section | None = None
    """Every combination."""
    t_way: TWay | None = None
    """Few combinations, in which every possible one of any `strength` producers' choices occurs."""
    sample: Sample | None = None
    """A number of combinations, spread over all of them."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of cartesian, t_way and sample, got {' and '.join(given) or 'nothing'}")
        return self


Design = Annotated[DesignSpec, BeforeValidator(_named_kind, json_schema_input_type=Literal["cartesian"] | DesignSpec)]
CARTESIAN: Final = DesignSpec(cartesian=Section())

Rate: TypeAlias = Annotated[Number, Field(gt=0, lt=1)]


class Stop(Section):
    """When the class of a configuration counts as shown, by its runs that pass all oracles."""

    error: Annotated[Number, Field(gt=0, lt=0.5)] = 0.05
    """Probability of a wrong class, at most, whatever the true rate of passing."""
    systematic: Rate = 0.2
    """Rate of passing up to which a configuration fails systematically."""
    reliable: Rate = 0.8
    """Rate of passing from which on a configuration passes reliably."""

    @model_validator(mode="after")
    def _in_order(self) -> "Stop":
        if not self.systematic < self.reliable:
            what = f"'systematic' is {self.systematic} and 'reliable' {self.reliable}"
            raise Invalid(what, "'systematic' must be less than 'reliable'")
        return self


class Sequential(Section):
    """Runs of a configuration end when its class is shown: reliable, systematic or flaky."""

    min: Count = 5
    """Runs of every configuration."""
    max: Count
    """Runs after which a configuration is undecided."""
    stop: Stop
    """When a class counts as shown; `{}` takes the error and the bounds of the paper."""

    @model_validator(mode="after")
    def _room(self) -> "Sequential":
        if self.min > self.max:
            raise Invalid(f"'min' is {self.min} and 'max' {self.max}", "'min' must not be greater than 'max'")
        return self


Repetitions: TypeAlias = Annotated[
    Annotated[Count, Tag("number")] | Annotated[Sequential, Tag("sequential")],
    Discriminator(lambda value: "sequential" if isinstance(value, Mapping | Sequential) else "number"),
]

Quantity: TypeAlias = Annotated[Any, WithJsonSchema({"type": ["number", "null"]})]
"""A quantity of a robot; `vastflow.sim.system.robot` reads and checks it."""
Flag: TypeAlias = Annotated[Any, WithJsonSchema({"type": ["boolean", "null"]})]


class NoiseSpec(Section):
    """The lidar's noise: the name of its model, and the model's parameters."""

    model_config = ConfigDict(extra="allow")

    model: str | None = None
    """Name of an installed model, or `file.py:Class` beside the campaign; `gaussian_dropout`, if not given."""


class LidarSpec(Section):
    """A laser scanner; defaults are a TurtleBot 4's, but a scanner with its own angles is mounted at 0."""

    x: Quantity = None
    """Position of its mount in the robot's frame (m); -0.04 on a TurtleBot 4."""
    y: Quantity = None
    """Position of its mount in the robot's frame (m)."""
    yaw: Quantity = None
    """Heading of its mount in the robot's frame (rad); the beams' angles begin there."""
    beams: Quantity = None
    """Beams of a scan, 2 to 4096; 360 on a TurtleBot 4."""
    angle_min: Quantity = None
    """Angle of the first beam (rad), counter-clockwise from the mount's yaw; with `angle_max`."""
    angle_max: Quantity = None
    """Angle of the last beam (rad), above `angle_min` by a turn at most."""
    range_min: Quantity = None
    """Shortest range it measures (m); 0.164 on a TurtleBot 4."""
    range_max: Quantity = None
    """Maximum range (m), from which on beams return nothing; 20 on a TurtleBot 4."""
    rate: Quantity = None
    """Scans a second (Hz), 1 to 20; it is held as a whole number of ticks of 50 ms."""
    sweeps: Flag = None
    """Whether each beam has a time of its own in the scanner's turn, counter-clockwise, so that scans of a moving robot are distorted."""
    noise: Annotated[NoiseSpec, EmptyIsMap] = Field(default_factory=NoiseSpec)
    """Noise of the ranges."""


class LatencySpec(Section):
    """Latencies of sensors and computers, with defaults from the preset.

    A jitter is the mean of an exponentially distributed addition to the least latency; ages are cut at 0.5 s.
    """

    preset: Annotated[Any, WithJsonSchema({"enum": [*PRESETS, None]})] = None
    """`ideal` (no latency, if not given), `gazebo`, or `loaded`."""
    scan_age: Quantity = None
    """Minimum time from the end of a scan until AMCL, costmaps, and collision monitor get it (s)."""
    scan_jitter: Quantity = None
    """Jitter of the scan's age (s)."""
    odometry_rate: Quantity = None
    """Samples of odometry and its transform a second (Hz), 5 to 100."""
    tf_age: Quantity = None
    """Minimum time from a sample of odometry until the stack gets it (s)."""
    tf_jitter: Quantity = None
    """Jitter of the odometry's age (s)."""
    controller_time: Quantity = None
    """Minimum time from the begin of a controller cycle until its command (s). No other cycle begins meanwhile."""
    controller_jitter: Quantity = None
    """Jitter of the controller's time (s)."""
    missed_cycles: Quantity = None
    """Share of the controller's cycles that are left out, 0 to 0.9."""
    smoother_in_step: Flag = None
    """Whether the velocity smoother runs right when a controller's cycle begins, or at a phase drawn for each run."""


class OdometrySpec(Section):
    """Drift of odometry's pose: standard deviations, which grow with the square root of what is driven and turned."""

    translation_std_per_meter: Quantity = None
    """Standard deviation of the distance after 1 m (m); four times as much after 16 m."""
    translation_std_per_radian: Quantity = None
    """Standard deviation of the distance after a turn of 1 rad (m)."""
    rotation_std_per_meter: Quantity = None
    """Standard deviation of the yaw after 1 m (rad)."""
    rotation_std_per_radian: Quantity = None
    """Standard deviation of the yaw after a turn of 1 rad (rad)."""


class RobotSpec(Section):
    """The robot that drives; defaults follow from the Nav2 parameters or a TurtleBot 4, as the report states."""

    namespace: Annotated[Any, WithJsonSchema({"type": ["string", "null"]})] = None
    """Namespace of the robot in a Nav2 parameter file of several; default: the first."""
    radius: Quantity = None
    """Radius of a round body (m); without a body, the local costmap's footprint collides with walls."""
    polygon: Annotated[Any, WithJsonSchema({"type": ["array", "string", "null"]})] = None
    """Outline of another body: `[[x, y], ...]` in the robot's frame (m), or Nav2's text of it."""
    drive: Annotated[Any, WithJsonSchema({"enum": [*get_args(Drive), None]})] = None
    """Kind of drive; default: MPPI's motion model."""
    min_turning_radius: Quantity = None
    """Minimum turning radius of an ackermann drive (m)."""
    mass: Quantity = None
    """Mass of the robot (kg), with which it pushes obstacles."""
    max_speed: Quantity = None
    """Greatest speed of the wheels' drive (m/s), whatever is commanded."""
    max_acceleration: Quantity = None
    """Greatest acceleration and deceleration of the drive (m/s²)."""
    max_yaw_rate: Quantity = None
    """Greatest yaw rate of the drive (rad/s)."""
    max_yaw_acceleration: Quantity = None
    """Greatest yaw acceleration of the drive (rad/s²)."""
    lidar: Annotated[LidarSpec, EmptyIsMap] = Field(default_factory=LidarSpec)
    """The laser scanner."""
    latency: Annotated[LatencySpec, EmptyIsMap] = Field(default_factory=LatencySpec)
    """Latencies of sensors and computers."""
    odometry: Annotated[OdometrySpec, EmptyIsMap] = Field(default_factory=OdometrySpec)
    """Drift of odometry's pose."""


def robot_places(
    document: Document, location: Location, fixed: Mapping[str, Location]
) -> tuple[dict[str, Location], list[Fault]]:
    """Places of the quantities below `location`, by their keys, and a fault for each that is a fixed parameter too.

    What the section has that no robot has is for its model to say.
    """
    found: dict[str, Location] = {}
    faults: list[Fault] = []
    noise = document.value((*location, *NOISE_PLACE[1:]))
    for key in dict.fromkeys([*robot_keys(), *_below(noise, NOISE_PLACE)]):
        where = (*location, *key.split(".")[1:])
        if document.value(where) is None:
            continue
        if key in fixed:
            line, _ = document.place(fixed[key], "key")
            what = f"duplicate key {key!r}, given in line {line} already"
            faults.append(document.fault(where, what, "keep one of them", "key"))
        found[key] = where
    return found, faults


def _below(value: Any, place: tuple[str, ...]) -> Iterator[str]:
    for name, item in value.items() if isinstance(value, Mapping) else ():
        yield from _below(item, (*place, str(name))) if isinstance(item, Mapping) else [".".join((*place, str(name)))]
