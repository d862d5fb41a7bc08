"""The robots of a campaign in words: what each family's is, and what of it is assumed."""

from collections.abc import Iterator, Sequence
from typing import Any

from vastflow.producers.family import Family
from vastflow.producers.scenario_values import dimension_of
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_of
from vastflow.sim.nav2.parameter_files.chosen import FOOTPRINT_NAMES, parameters_of
from vastflow.sim.nav2.parameter_files.document import DocumentError
from vastflow.sim.nav2.parameters.robot import robot_keys
from vastflow.sim.reading.robot import robot_facts, robot_of, robot_words


def robots_json(families: Sequence[Family]) -> list[dict[str, Any]]:
    """Each robot of a campaign's families, with the names of those that it drives in and a line for each source of its quantities."""
    found: dict[tuple[str, ...], list[str]] = {}
    for family in families:
        if family.drives and (lines := tuple(_lines(family))):
            found.setdefault(lines, []).append(family.name)
    return [{"families": names, "robot": list(lines)} for lines, names in found.items()]


def _lines(family: Family) -> Iterator[str]:
    values = {**family.values, **family.overrides}
    system = {
        key: value
        for key, value in values.items()
        if dimension_of(key, value, family.dimensions.get(key)) == "system" and not key.startswith("_")
    }
    try:
        parameters = parameters_of(system)
        yield from robot_words(robot_facts(parameters))
        radii_m = inscribed_radius_of(parameters), robot_of(parameters).radius_m
        yield "oracles without a radius of their own: performance takes {:.3g} m (inscribed), safety {:.3g} m (circumscribed)".format(
            *radii_m
        )
    except DocumentError:  # with what producers write it may be right, and the run says where it isn't
        return
    varied = dict.fromkeys(key for producer in family.producers for key in producer.writes if _is_of_robot(key))
    if varied:
        yield f"varied: {', '.join(varied)}"


def _is_of_robot(key: str) -> bool:
    return key in robot_keys() or key.rpartition(".")[2] in FOOTPRINT_NAMES
