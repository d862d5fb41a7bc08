"""The chain of a command: controller, velocity smoother, collision monitor, base, joined by their topics."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any, Final, NamedTuple

from vastflow.sim.model.parameter import ParameterLocation
from vastflow.sim.nav2.parameter_files.costmaps import TOPIC, filter_gap, meets, shown_topic, topic_of
from vastflow.sim.nav2.parameter_files.declared import declared_defaults
from vastflow.sim.nav2.parameter_files.document import PARAMETERS, ParameterDocument, is_wild
from vastflow.sim.nav2.parameter_files.reader import Parts, Reader
from vastflow.sim.nav2.parameter_files.releases import release_of
from vastflow.sim.nav2.parameters.costmap import NEVER_HZ
from vastflow.sim.nav2.parameters.servers import VelocitySmoother

NO_SMOOTHER: Final = VelocitySmoother(
    max_velocity=(100.0, 100.0, 100.0),
    min_velocity=(-100.0, -100.0, -100.0),
    max_accel=(1000.0, 1000.0, 1000.0),
    max_decel=(-1000.0, -1000.0, -1000.0),
    velocity_timeout=1e6,
)
"""A smoother that lets every command through: only the actuators' limits are left."""

_STANDING: Final = VelocitySmoother(max_velocity=(0.0, 0.0, 0.0), min_velocity=(0.0, 0.0, 0.0))
"""A smoother whose commands do not arrive: the robot stands."""


def monitored_topics(document: ParameterDocument) -> tuple[str, str] | None:
    """Return the topics that the collision monitor listens and publishes on; None without one."""
    node, declared = document.node("collision_monitor"), declared_defaults()["collision_monitor"]
    if node is None:
        return None
    topics = (document.values.get((*node, name), declared[name].default) for name in _MONITORED)
    into, out = map(topic_of, topics)
    return into, out


def smoother_between(reader: Reader) -> Mapping[str, VelocitySmoother]:
    """Return the smoother that commands pass by the topics of the collision monitor, where it is not the file's."""
    node = reader.document.node("collision_monitor") or ()
    paths = [(*node, name) for name in _MONITORED]
    reader.asked |= {path: reader.document.values[path] for path in paths if path in reader.document.values}
    if (other := _of_other_type(reader.document)) is not None:
        words = "the commands of the node before it have another type, with a stamp or without"
        reader.warnings[(*other, STAMPED)] = words, "no command arrives: the robot stands"
        return {"velocity_smoother": _STANDING}
    match monitored_topics(reader.document):
        case None | ("cmd_vel_smoothed", "cmd_vel"):
            return {}
        case ("cmd_vel_smoothed", out):
            reader.warnings[paths[1]] = (
                f"publishes on {out}",
                "the robot drives if its base listens there, as is assumed",
            )
            return {}
        case ("cmd_vel_nav", _):
            words = "listens on cmd_vel_nav, where the controller publishes"
            reader.warnings[paths[0]] = words, "the velocity smoother has no effect"
            return {"velocity_smoother": NO_SMOOTHER}
        case (into, _):
            words = f"listens on {into}, and the velocity smoother publishes on cmd_vel_smoothed"
            reader.warnings[paths[0]] = words, "no command arrives: the robot stands"
            return {"velocity_smoother": _STANDING}


def _of_other_type(document: ParameterDocument) -> ParameterLocation | None:
    """Return the first node that expects commands of another type than the node before it sends."""
    values, usual = document.values, release_of(document) != "jazzy"
    usual = [usual, *(bool(values[path]) for path in values if path[-1] == STAMPED and is_wild(path))][-1]
    nodes = [document.node(name) or (name, PARAMETERS) for name in ("controller_server", "velocity_smoother")]
    nodes += filter(None, [document.node("collision_monitor")])
    stamped = [values.get((*node, STAMPED), usual) for node in nodes]
    return next((node for node, own in zip(nodes, stamped, strict=True) if own != stamped[0]), None)


class _Listener(NamedTuple):
    """A parameter of a kind of group that names a topic.

    Attributes:
        published: Topics on which it would hear what it needs; the first is the default.
        changes: Group of `NavParameters` to what it has where nothing is heard.
        consequence: That, in words.
    """

    kind: str
    parameter: str
    published: tuple[str, ...]
    changes: Mapping[str, Mapping[str, Any]]
    consequence: str


_OUTLINES: Final = "local_costmap/published_footprint", "global_costmap/published_footprint"
_COLLIDING: Final = {"local_costmap": {"publish_frequency": NEVER_HZ}}
_LISTENERS: Final = (
    _Listener(
        *("approach polygon", "footprint_topic", _OUTLINES, {"collision_monitor": {"enabled": False}}),
        "the area gets no shape, and has no effect",
    ),
    *(
        _Listener("behavior_server", name, topics, _COLLIDING, "spin and back-up end at once, as before a collision")
        for name, topics in (
            ("local_costmap_topic", ("local_costmap/costmap_raw",)),
            ("local_footprint_topic", _OUTLINES),
        )
    ),
)


def unheard_listeners(reader: Reader, parts: Parts) -> Parts:
    """Return the groups that change as nothing publishes on a topic that a file names."""
    document, changed = reader.document, dict[str, Any]()
    for each in _LISTENERS:
        for path in [(*place, each.parameter) for place, kind in reader.kinds.items() if kind == each.kind]:
            topic = document.values.get(path, each.published[0])
            if not any(meets(topic, said) for said in each.published):
                reader.asked[path] = topic
                reader.warnings[path] = f"nothing publishes on {shown_topic(topic)}", each.consequence
                changed |= {name: parts[name].with_values(**values) for name, values in each.changes.items()}
    return changed


STAMPED: Final = "enable_stamped_cmd_vel"
_MONITORED: Final = ("cmd_vel_in_topic", "cmd_vel_out_topic")


def command_chain(document: ParameterDocument, left_away: Collection[str]) -> str:
    """Draw the chain of a command from the controller to the base, by its topics."""
    smoother = "" if "velocity_smoother" in left_away else " → velocity_smoother"
    other = (_of_other_type(document) or ("", ""))[-2]
    smoother = f" ✗{smoother}" if other == "velocity_smoother" else smoother
    topics = monitored_topics(document)
    if topics is None:
        return f"controller{smoother} → base"
    into, out = topics
    if into == "cmd_vel_nav":
        through = " → (cmd_vel_nav) "
    else:
        gap = "" if into == "cmd_vel_smoothed" else f" ✗ ({into})"
        through = f"{smoother} → (cmd_vel_smoothed){gap} "
    return f"controller{through}{'✗ ' if other == 'collision_monitor' else ''}→ collision_monitor → ({out}) → base"


def filter_chains(reader: Reader) -> Iterator[str]:
    """Draw the chain of each costmap filter, from its info server to the controller that a speed filter limits."""
    document, declared = reader.document, declared_defaults()
    for place, kind in reader.kinds.items():
        if kind not in ("KeepoutFilter", "SpeedFilter") or reader.asked.get((*place, "enabled")) is False:
            continue
        topic = document.values.get((*place, TOPIC), "")
        gap = filter_gap(document, place, kind)
        chain = f"mask → ({topic}){' ✗' * bool(gap)} → {place[-3]}/{place[-1]}"
        if kind == "SpeedFilter":
            server = document.node("controller_server") or ()
            said, heard = (
                document.values.get((*at, "speed_limit_topic"), declared[of]["speed_limit_topic"].default)
                for at, of in ((place, kind), (server, "controller_server"))
            )
            gap_to = "" if meets(said, heard) else f" ✗ ({shown_topic(heard)})"
            chain += f" → ({shown_topic(said)}){gap_to} → controller"
        yield f"{chain}: {gap}" if gap else chain
