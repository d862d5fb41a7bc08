"""The campaign file, version 1 of the format, as pydantic models and as JSON Schema."""

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import AfterValidator, BaseModel, Field, WithJsonSchema
from pydantic.json_schema import models_json_schema
from pydantic_core import PydanticCustomError

from vastflow.producers.campaign_file.containers import Containers, Runtime
from vastflow.producers.campaign_file.nodes import NodeSpec, Ros2Spec
from vastflow.producers.campaign_file.search import SearchSpec
from vastflow.producers.campaign_file.sections import (
    CARTESIAN,
    Design,
    EmptyIsList,
    EmptyIsMap,
    FreeForm,
    NamedSteps,
    Repetitions,
    RobotSpec,
    Section,
    SingleKeys,
    Unexecuted,
)
from vastflow.producers.model.faults import Location
from vastflow.producers.model.numbers import Amount, Count, Positive, Seed
from vastflow.producers.model.producer import PRODUCERS, find_producer
from vastflow.sim.model.faults import Got, Invalid
from vastflow.sim.model.names import nearest
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.system.keys import Release

DEFAULT_TIMEOUT_S: Final = 360.0
"""Simulated time after which a run ends where the file says nothing: the timeout of the paper's scenario file."""
BUILTIN: Final = "builtin:"
RESERVED_ENV: Final = ("CAMPAIGN_ID", "ROS_LOG_DIR", "PRE_COMMAND", "POST_COMMAND")
MAX_NAME: Final = 100


def _family_name(name: str) -> str:
    """Names become names of files, so besides the format's rules none may hold a separator."""
    wrong = any(c in '_./\\:*?"<>|' or c.isspace() or not c.isprintable() or c != c.lower() for c in name)
    if wrong or not name or name.startswith("-") or len(name) > MAX_NAME:
        right = "lowercase letters, digits and hyphens, such as 'rooms-noise', at most 100"
        raise Invalid(Got(repr(name[:MAX_NAME])), right)
    return name


def _inside(path: str) -> str:
    depth = 0
    for part in PurePosixPath(path).parts:
        depth += -1 if part == ".." else 1
        if part == "/" or depth < 0:
            raise Invalid(Got(repr(path)), "a path below the campaign file's folder")
    return path


def _one_env(entry: dict[str, Any]) -> dict[str, Any]:
    if name := next((name for name in entry if name in RESERVED_ENV), None):
        said = Invalid(f"{name} is set for every run", "choose another name")
        raise PydanticCustomError("reserved", "{error}", {"error": said, "at": name})
    return entry


def _one_node(entry: dict[str, NodeSpec]) -> dict[str, NodeSpec]:
    if len(entry) != 1:
        raise Invalid(Got(f"{len(entry)} nodes in one entry"), "one, as 'name: {command: ...}'")
    return entry


PerCluster: TypeAlias = list[dict[str, Count]]

_EXPRESSIONS = {"type": "object", "additionalProperties": {"type": "string"}}

Constraints: TypeAlias = Annotated[
    Any, WithJsonSchema({"anyOf": [{"type": "array", "items": _EXPRESSIONS}, _EXPRESSIONS, {"type": "null"}]})
]
"""Named expressions; `vastflow.producers.constraints.reading` reads and checks them."""


class Resources(Section):
    """Resources that a container requests of its node; a list gives each cluster (kubeconfig context) its own."""

    cpu: Count | PerCluster | None = None
    """Cores; a number, or a list `- cluster: number`."""
    memory: str | list[dict[str, str]] | None = None
    """Memory in units of Kubernetes, such as `8Gi` or `512Mi`; an amount, or a list `- cluster: amount`."""
    gpu: Amount | None = None
    """Number of GPUs."""


class Local(Section):
    """Settings of runs on the user's own machine."""

    parameter_overrides: SingleKeys = Field(default_factory=list)
    """Values of the scenario file's parameters, in place of those of every configuration."""


class Nodes(Section):
    """Selection of cluster nodes."""

    node_labels: FreeForm = Field(default_factory=dict)
    """Labels that a node must have, `label: value`."""
    tolerations: list[dict[str, str | int]] = Field(default_factory=list)
    """Tolerations of tainted nodes, as in a pod of Kubernetes. Not part of version 1 elsewhere."""


class Kubernetes(Section):
    """Settings of runs in a cluster."""

    jobs: Nodes | None = None
    """Nodes for the jobs that execute runs."""
    control: Nodes | None = None
    """Nodes for what controls the campaign."""


class ExecutionSpec(Section):
    """Execution of the configurations."""

    image: Annotated[str | None, Unexecuted("the simulator in this package runs every configuration")] = None
    """Container image of the system under test."""
    runs: Repetitions = 1
    """Repetitions of each configuration: a number, or `{min, max, stop: {error, systematic, reliable}}`, with which they end when its
    class is shown. A number is all that version 1 has elsewhere."""
    seed: Seed = 0
    """Seed of the runs' noise. Not part of version 1 elsewhere."""
    max_configurations: Count = 100_000
    """Configurations that the file may ask for; more are refused before any is made. Not part of version 1 elsewhere."""
    max_runs: Count = 10_000_000
    """Runs of all configurations that may be asked for. Not part of version 1 elsewhere."""
    scenario_file: Annotated[str, AfterValidator(_inside)] | None = None
    """The abstract scenario: `builtin:navigate_to_pose`, `builtin:navigate_through_poses`,
    `builtin:follow_waypoints`, `builtin:obstacle_appears`, or an OpenSCENARIO DSL file below the campaign file's folder. Without it the
    mission follows from the goal: goal_pose or goal_poses."""
    timeout: Positive | None = None
    """Simulated seconds after which a run ends as timed out; 360 where nothing is given."""
    nav2_params: str | None = None
    """Nav2 parameter file; the parameters of Nav2 Jazzy's default file where nothing is given. Not part of version 1
    elsewhere."""
    nav2_release: Release | None = None
    """Release of Nav2 that the file is for; guessed from its parameters where nothing is given. Not part of version 1 elsewhere."""
    simulation: Annotated[
        Annotated[str, Field(pattern=r"^[\w.]+:\w+$")] | None, Unexecuted("the simulator in this package is used")
    ] = None
    """`module:Class` of another simulation."""
    resources: Annotated[Resources | None, Unexecuted("a run takes one core of this machine")] = None
    """Resources that the main container requests from its node."""
    secondary_containers: Annotated[Annotated[list[Any], EmptyIsList], Unexecuted("no containers are started")] = Field(
        default_factory=list
    )
    """Containers beside the main one, in whatever form, of the same image if they give none."""
    containers: Containers = Field(default_factory=dict)
    """Containers of each run by name. The scenario's programs are started in `main`, if there is one. Not part of version 1 elsewhere."""
    container_runtime: Runtime | None = None
    """What runs containers; `any`, if not given: the first that works. With it, `image` and `secondary_containers` are run too. Not part
    of version 1 elsewhere."""
    env: Annotated[list[Annotated[dict[str, Any], AfterValidator(_one_env)]], EmptyIsList] = Field(default_factory=list)
    """Environment variables of the containers, and of the programs a scenario starts, `- NAME: value`."""
    system: Literal["nav2", "ros2"] = "nav2"
    """What drives the robot: the simulator's own stack, or nodes of ROS 2. Not part of version 1 elsewhere."""
    nodes: Annotated[list[Annotated[dict[str, NodeSpec], AfterValidator(_one_node)]], EmptyIsList] = Field(
        default_factory=list
    )
    """Processes of each run in the order of their start, `- name: {command, ready}`. Not part of version 1 elsewhere."""
    ros2: Annotated[Ros2Spec, EmptyIsMap] = Field(default_factory=Ros2Spec)
    """How robot and nodes meet. Not part of version 1 elsewhere."""
    run_files: Annotated[list[str], EmptyIsList] = Field(default_factory=list)
    """Files each run needs, as glob patterns; programs a scenario starts find them in their folder."""
    config_files: Annotated[
        dict[Annotated[str, Field(pattern=r"^[\w-]+$")], Annotated[str, AfterValidator(_inside)]], EmptyIsMap
    ] = Field(default_factory=dict)
    """YAML, JSON, or XML files below the campaign file's folder, by name: run files whose parameters `sut.NAME.PATH` are varied. Not part
    of version 1 elsewhere."""
    runs_per_job: Annotated[Count, Unexecuted("runs are shared out over this machine's cores")] = 1
    """Runs that share one job of a cluster."""
    pre_command: str | None = None
    """Script that is sourced before a run's programs start: a run file, or its path in the container."""
    post_command: str | None = None
    """Program that runs after a run, with the run's folder as its last argument: a run file, or its path in the container."""
    run_as_user: Annotated[Amount, Unexecuted()] = 1000
    """User id in the container."""
    local: Local | None = None
    """Settings of runs on the user's own machine."""
    kubernetes: Annotated[Kubernetes | None, Unexecuted("runs stay on this machine")] = None
    """Settings of runs in a cluster."""


StartCheckKind: TypeAlias = Literal["footprint", "none"]
"""Required free space at the start and the goals of a configuration."""


class FamilySpec(Section):
    """A scenario family: fixed parameters and the ordered producers that vary the rest."""

    name: Annotated[str, AfterValidator(_family_name)]
    """Lowercase letters, digits and hyphens; configurations are called `<name>-1`, `<name>-1-2` and so on."""
    parameters: SingleKeys = Field(default_factory=list)
    """Fixed parameters, `- name: value`."""
    robot: Annotated[RobotSpec, EmptyIsMap] = Field(default_factory=RobotSpec)
    """The robot that drives. Its quantities are parameters `robot.…`, which producers vary as others. Not part of version 1
    elsewhere."""
    variations: SingleKeys = Field(default_factory=list)
    """Producers in order, `- Producer: {parameters}`; a producer is a known name or `file.py:Class`."""
    dimensions: Annotated[dict[str, Dimension], EmptyIsMap] = Field(default_factory=dict)
    """Dimension of a fixed parameter where it is not the usual one. Not part of version 1 elsewhere."""
    start_check: StartCheckKind = "footprint"
    """Whether the footprint of the local costmap must fit at the start and the goals: `footprint`, or `none`, with which a robot may
    begin in collision. Not part of version 1 elsewhere."""
    design: Design = CARTESIAN
    """Combinations that become configurations: `cartesian` (all), `t_way: {strength}` or `sample: {method, size, seed}`. Not
    part of version 1 elsewhere."""
    constraints: Constraints = None
    """Conditions of a configuration, `- name: "expression"`. Not part of version 1 elsewhere."""


class ResultsProcessingSpec(Section):
    """Processing of the results."""

    postprocessing: NamedSteps = Field(default_factory=list)
    """Steps over a copy of the results, `- file.py:Class`, `- command: {script, args}`, or a name that RoboVAST has."""
    metadata_processing: Annotated[NamedSteps, Unexecuted()] = Field(default_factory=list)
    """Steps over the metadata of the results."""
    publication: Annotated[NamedSteps, Unexecuted("results stay in the campaign directory")] = Field(
        default_factory=list
    )
    """Steps that publish the results."""


class Notebooks(Section):
    """Notebooks of one tab."""

    run: str | None = None
    """Notebook about one run, relative to the campaign file."""
    config: str | None = None
    """Notebook about one configuration, relative to the campaign file."""
    batch: str | None = None
    """Notebook about one batch of a search, relative to the campaign file."""
    campaign: str | None = None
    """Notebook about the whole campaign, relative to the campaign file."""


def _one_tab(entry: dict[str, Notebooks]) -> dict[str, Notebooks]:
    if len(entry) != 1:
        raise Invalid(Got(f"{len(entry)} tabs in one entry"), "one, as 'Tab: ...'")
    return entry


class EvaluationSpec(Section):
    """Judgment and display of runs."""

    oracles: NamedSteps = Field(default_factory=list)
    """Oracles that judge each run, `- name` or `- name: {parameters}`. Not part of version 1 elsewhere."""
    visualization: Annotated[list[Annotated[dict[str, Notebooks], AfterValidator(_one_tab)]], EmptyIsList] = Field(
        default_factory=list
    )
    """Notebooks over the results, `- Tab: {run, config, campaign}`."""


class CampaignSpec(Section):
    """A campaign file (`.vast`), version 1."""

    version: Literal[1] = 1
    """Version of the format."""
    metadata: FreeForm = Field(default_factory=dict)
    """Free-form; `name` begins the name of the campaign directory."""
    general: Annotated[FreeForm, Unexecuted("no producer of this version reads it")] = Field(default_factory=dict)
    """Free-form, for every producer."""
    configuration: Annotated[list[FamilySpec], EmptyIsList] = Field(default_factory=list)
    """The scenario families."""
    search: SearchSpec | None = None
    """Families that an optimiser proposes, in place of `configuration`."""
    constraints: Constraints = None
    """Conditions of the configurations of every family. Not part of version 1 elsewhere."""
    execution: Annotated[ExecutionSpec, EmptyIsMap] = Field(default_factory=ExecutionSpec)
    """Runs of each configuration, their scenario and time, and where they are executed."""
    results_processing: Annotated[ResultsProcessingSpec, EmptyIsMap] = Field(default_factory=ResultsProcessingSpec)
    """Steps over the results, once the campaign directory is complete."""
    evaluation: Annotated[EvaluationSpec, EmptyIsMap] = Field(default_factory=EvaluationSpec)
    """The oracles that judge each run."""


def is_tolerated_in_family(key: str) -> bool:
    """Whether an unknown key of a family is tolerated, because it resembles no known key."""
    known = FamilySpec.model_fields
    usual = {*ExecutionSpec.model_fields, "description", "title", "metadata"}
    return key not in known and (key in usual or nearest(key, known) is None)


def unexecuted(section: BaseModel, location: Location = ()) -> Iterator[tuple[Location, str]]:
    """Every key that the file gives and this version does nothing with, and what follows from that."""
    for name in sorted(section.model_fields_set & type(section).model_fields.keys()):  # noise has its model's own
        field, value = type(section).model_fields[name], getattr(section, name)
        marks = [mark for mark in field.metadata if isinstance(mark, Unexecuted)]
        if marks:
            yield (*location, name), marks[0].consequence
        elif isinstance(value, BaseModel):
            yield from unexecuted(value, (*location, name))
        elif isinstance(value, list):
            for i, item in enumerate(value):
                if isinstance(item, BaseModel):
                    yield from unexecuted(item, (*location, name, i))


TITLE = "vastflow campaign file, version 1"
_PLACE: Final = "#/$defs/"


def campaign_schema() -> dict[str, Any]:
    """The schema of a `.vast` file (JSON Schema 2020-12), with the parameters of every installed producer."""
    producers = {name: find_producer(name) for name in PRODUCERS.known}
    models = {producer.Parameters: name for name, producer in producers.items()}
    references, definitions = models_json_schema(
        [(CampaignSpec, "validation"), *((model, "validation") for model in models)],
        ref_template=_PLACE + "{model}",
    )
    schemas: dict[str, Any] = dict(definitions.get("$defs", {}))
    variation = {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 1,
        "properties": {
            name: {
                "anyOf": [references[producer.Parameters, "validation"], {"type": "null"}],
                "description": (producer.__doc__ or name).partition("\n")[0],
            }
            for name, producer in producers.items()
        },
        "patternProperties": {r"\.py:\w+$": {"type": ["object", "null"]}},
        "additionalProperties": False,
    }
    schemas["FamilySpec"]["properties"]["variations"]["items"] = variation
    campaign, used = schemas.pop("CampaignSpec"), set[str]()
    waiting: list[Any] = [campaign]
    while waiting:  # the definitions that are referred to, directly or through others
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
            name = str(value.get("$ref", "")).removeprefix(_PLACE)
            if name in schemas and name not in used:
                used.add(name)
                waiting.append(schemas[name])
        elif isinstance(value, (list, tuple)):
            waiting += value
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **campaign,
        "title": TITLE,
        "$defs": {name: schemas[name] for name in sorted(used)},
    }
