"""The robots of a campaign's families, in words."""

from collections.abc import Iterator, Sequence
from typing import Any

from vastflow.producers.campaign_file.scenario_values import dimension_of
from vastflow.producers.instantiation.instantiate import Family
from vastflow.sim.model.faults import FileError
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.system.facts import robot_words
from vastflow.sim.system.keys import FOOTPRINT_NAMES
from vastflow.sim.system.robot import ROBOT_KEY
from vastflow.sim.system.system import system_of


def robots_json(families: Sequence[Family], nodes: Nodes | None = None) -> list[dict[str, Any]]:
    """Return each robot of a campaign, with its families, whose it is, and sources of its quantities.

    Args:
        nodes: The nodes that drive it; None where the built-in stack does.
    """
    found: dict[tuple[str, ...], list[str]] = {}
    driven_by = (
        ""
        if nodes is None
        else f"driven by nodes of ROS 2 ({nodes.words}); of Nav2's parameters only the robot's count"
    )
    for family in families:
        lines = [*_lines(family)] if family.drives else []
        if lines and driven_by:
            lines[0] = f"{driven_by}; {lines[0]}"
        if lines:
            found.setdefault(tuple(lines), []).append(family.name)
    return [{"families": names, "summary": whose, "robot": lines} for (whose, *lines), names in found.items()]


def _lines(family: Family) -> Iterator[str]:
    values = {**family.values, **family.overrides}
    system = {
        key: value
        for key, value in values.items()
        if dimension_of(key, value, family.dimensions.get(key)) == "system" and not key.startswith("_")
    }
    written = dict.fromkeys(key for producer in family.producers for key in producer.writes)
    names = [k for k in written if k.startswith(f"{ROBOT_KEY}.") or k.rpartition(".")[2] in FOOTPRINT_NAMES]
    varied = [f"varied: {', '.join(names)}"] if names else []
    try:
        driven = system_of(system)
        yield "; ".join([driven.whose, *varied])
        yield from robot_words(driven.facts)
        inner_m, outer_m = driven.inscribed_radius_m, driven.robot.radius_m
        own = f"performance takes {inner_m:.3g} m (inscribed), safety {outer_m:.3g} m (circumscribed)"
        yield f"oracles without a radius of their own: {own}"
    except FileError:  # with what producers write it may be right, and the run says where it isn't
        return
    yield from varied
