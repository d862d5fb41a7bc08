"""From families to configurations."""

from collections.abc import Iterator

import pytest
from families import Campaign, family, grown, levels, made
from table import each_row

from vastflow.producers.instantiation.instantiate import growth_of, instantiate, instantiation_of
from vastflow.producers.model import producer as producer_module
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Producer, check_declared, evaluate
from vastflow.sim.plug_ins.neighbors import PlugInError


def paths(**parameters):
    return made("PathVariationRandom", {"path_length": 5, "goal_poses": "@goal_pose", **parameters})


def obstacles(amount, **parameters):
    placed = [{"amount": amount, "max_distance": 0.5}]
    return made("ObstacleVariation", {"obstacle_configs": placed, "seed": 4, **parameters})


def configurations(*families, **others):
    return instantiate(Campaign(families, **others)).configurations


class Picky(Producer[producer_module.Parameters]):
    """Takes odd levels twice, rejects even ones, says nothing of zero; keeps a count of its evaluations."""

    Parameters = producer_module.Parameters
    evaluations = 0
    reads = ("noise",)
    writes = {"gain": "task"}  # noqa: RUF012

    def produce(self, inputs, draws) -> Iterator[Fragment | Rejection]:
        type(self).evaluations += 1
        if inputs["noise"] % 2:
            yield Rejection("first of three", {"gain": 0})
            yield Fragment({"gain": 1})
            yield Fragment({"gain": 2, "_why": "odd"})
        elif inputs["noise"]:
            yield Rejection("even", {"gain": 1})


@pytest.fixture
def picky():
    Picky.evaluations = 0
    return Picky(Picky.Parameters())


@pytest.fixture(scope="module")
def hall(drawn_map):
    return drawn_map(*["." * 20] * 20, cells=10)


def test_earliest_producer_is_outermost():
    found = configurations(family(levels("noise", 0.0, 0.1), levels("loops", 1, 2, 3)))
    assert [c.name for c in found] == [f"rooms-{i}-{k}" for i in (1, 2) for k in (1, 2, 3)]
    assert [(c.factors["noise"], c.factors["loops"]) for c in found] == [(n, k) for n in (0.0, 0.1) for k in (1, 2, 3)]


def test_producer_is_evaluated_once_per_distinct_input(picky):
    found = configurations(family(levels("noise", 1, 3), levels("loops", 1, 2, 3), picky))
    assert Picky.evaluations == 2
    assert len(found) == 2 * 3 * 2


def test_rejections_use_no_number_and_name_parent(picky):
    found = grown(levels("noise", 1, 2, 0), picky)
    assert [c.name for c in found.configurations] == ["rooms-1-1", "rooms-1-2"]
    assert [(r.family, r.parent, r.producer, r.reason) for r in found.rejections] == [
        ("rooms", "rooms-1", "Picky", "first of three"),
        ("rooms", "rooms-2", "Picky", "even"),
        ("rooms", "rooms-3", "Picky", "Picky yielded nothing for this input"),
    ]
    assert found.rejections[1].requested == {"gain": 1}
    assert found.rejections[1].inputs == {"noise": 2}


def test_steps_give_the_same_as_instantiate():
    chain = family(levels("noise", 1, 2), levels("noise", 3))
    growth = growth_of(chain)
    for step in chain.producers:
        inputs = growth.inputs()
        assert len(inputs) == 1
        # Tasks may be done in any order.
        growth.join({key: evaluate(step, value) for key, value in reversed(inputs.items())})
    assert instantiation_of(Campaign((chain,)), [growth.grown()]).configurations == configurations(chain)


def test_provenance_and_steps_are_kept_beside_the_scenario(picky):
    one, other = configurations(family(picky, values={"noise": 1}))
    assert (one.provenance, other.provenance) == ({}, {"_why": "odd"})
    assert [(step.producer, step.keys) for step in other.steps] == [("Picky", ("gain", "_why"))]
    assert "_why" not in other.factors
    assert other.scenario.task == {"gain": 2}


def test_producer_and_the_file_tag_dimensions():
    tagged = levels("a", 1, dimension="task")
    (only,) = configurations(family(tagged, values={"b": 2, "c": 3}, dimensions={"b": "environment"}))
    assert (only.scenario.environment, only.scenario.task, only.scenario.system) == ({"b": 2}, {"a": 1}, {"c": 3})


GOAL = {"x": 1, "y": 1}


@each_row(
    ("values", "abstract", "expected"),
    [
        ({"goal_pose": GOAL}, "", "builtin:navigate_to_pose"),
        ({"goal_poses": [GOAL]}, "", "builtin:navigate_through_poses"),
        ({"goal_poses": [GOAL]}, "builtin:follow_waypoints", "builtin:follow_waypoints"),
    ],
)
def test_mission_follows_from_the_goal(values, abstract, expected):
    (only,) = configurations(family(values=values), abstract=abstract)
    assert only.scenario.abstract == expected


def test_duplicates_are_found_across_families():
    found = configurations(family(levels("noise", 1, 2, 1)), family(levels("noise", 2), name="again"))
    assert [(c.name, c.duplicate_of) for c in found] == [
        ("rooms-1", None),
        ("rooms-2", None),
        ("rooms-3", "rooms-1"),
        ("again-1", "rooms-2"),
    ]


def test_empty_placements_are_duplicates(hall):
    found = configurations(family(paths(), obstacles(0, count=3), values={"map_file": hall}))
    assert [c.duplicate_of for c in found] == [None, "rooms-1-1", "rooms-1-1"]


def test_same_seed_gives_the_same_paths_and_obstacles_whatever_else_varies(hall):
    values = {"map_file": hall}
    drawn, placed = paths(num_paths=2), obstacles(3)
    alone = configurations(family(drawn, placed, values=values))
    after = configurations(family(levels("noise", 1, 2), drawn, placed, values=values))
    before = configurations(family(drawn, levels("noise", 1, 2, 3), placed, values={**values, "robot_radius": 0.2}))
    parts = [(c.scenario.task, c.scenario.environment) for c in alone]
    assert [(c.scenario.task, c.scenario.environment) for c in after] == parts * 2
    assert [(c.scenario.task, c.scenario.environment) for c in before] == [part for part in parts for _ in range(3)]


def test_drawn_configuration_is_pinned(hall):
    (only,) = configurations(family(paths(seed=42), obstacles(2), values={"map_file": hall}))
    assert only.scenario.digest == "d31ad8fdd3c288853e8416dede4b1a6b94e35915d3f36381090f2e157e2aef27"


@each_row(
    ("values", "message"),
    [
        ({"loss": 1}, "Loose writes 'loss', which it does not declare"),
        ({"gain": [{"spawn_pose": {"x": 1, "y": 1}}]}, "Loose writes obstacles under 'gain' as task, where no"),
    ],
)
def test_producer_writes_what_it_declares_and_obstacles_to_the_environment(values, message):
    loose = type("Loose", (Picky,), {"produce": lambda self, inputs, draws: iter([Fragment(values)])})
    with pytest.raises(PlugInError, match=message):
        evaluate(loose(producer_module.Parameters()), {"noise": 1})


@each_row(
    ("declared", "message"),
    [
        (
            {"writes": {"gain": "world"}},
            r"Odd writes 'gain' as 'world'\. Expected one of environment, task, system, or None",
        ),
        ({"reads": "noise"}, r"Odd reads the text 'noise'. Write a tuple of keys, \('noise',\)"),
    ],
)
def test_declarations_of_a_producer_are_checked(declared, message):
    odd = type("Odd", (Picky,), declared)(producer_module.Parameters())
    with pytest.raises(PlugInError, match=message):
        check_declared(odd)
