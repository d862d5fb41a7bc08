"""From families to configurations."""

from collections.abc import Iterator

import pytest
from families import Campaign, made
from table import each_row

from vastflow.producers.instantiation.instantiate import Family, growth_of, instantiate, instantiation_of
from vastflow.producers.model import producer as producer_module
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Producer, check_declared, evaluate
from vastflow.sim.plug_ins.neighbors import PlugInError


def family_of(*chain, name="rooms", values=None, dimensions=None):
    producers = tuple(made(kind, parameters) for link in chain for kind, parameters in link.items())
    return Family(name, values or {}, dimensions or {}, producers)


def noise(*levels):
    return {"ParameterVariationList": {"name": "noise", "values": list(levels)}}


def paths(**parameters):
    return {"PathVariationRandom": {"path_length": 5, "goal_poses": "@goal_pose", **parameters}}


def configurations(*families, **others):
    return instantiate(Campaign(families, **others)).configurations


class Picky(Producer[producer_module.Parameters]):
    """Takes odd levels twice, rejects even ones, says nothing of zero; keeps a count of its evaluations."""

    Parameters = producer_module.Parameters
    evaluations = 0

    @property
    def reads(self):
        return ("noise",)

    @property
    def writes(self):
        return {"gain": "task"}

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
    found = configurations(
        family_of(noise(0.0, 0.1), {"ParameterVariationList": {"name": "loops", "values": [1, 2, 3]}})
    )
    assert [c.name for c in found] == [f"rooms-{i}-{k}" for i in (1, 2) for k in (1, 2, 3)]
    assert [(c.factors["noise"], c.factors["loops"]) for c in found] == [(n, k) for n in (0.0, 0.1) for k in (1, 2, 3)]


def test_names_are_unique_over_alternatives():
    found = configurations(family_of(noise(1, 2), {"OneOfVariation": {"variations": [noise(3, 4), noise(5)]}}))
    assert len({c.name for c in found}) == len(found) == 6


def test_producer_is_evaluated_once_per_distinct_input(picky):
    with_loops = family_of(noise(1, 3), {"ParameterVariationList": {"name": "loops", "values": [1, 2, 3]}})
    chain = Family("rooms", {}, {}, (*with_loops.producers, picky))
    found = configurations(chain)
    assert Picky.evaluations == 2
    assert len(found) == 2 * 3 * 2


def test_rejections_use_no_number_and_name_parent(picky):
    chain = Family("rooms", {}, {}, (*family_of(noise(1, 2, 0)).producers, picky))
    found = instantiate(Campaign((chain,)))
    assert [c.name for c in found.configurations] == ["rooms-1-1", "rooms-1-2"]
    assert [(r.family, r.parent, r.producer, r.reason) for r in found.rejections] == [
        ("rooms", "rooms-1", "Picky", "first of three"),
        ("rooms", "rooms-2", "Picky", "even"),
        ("rooms", "rooms-3", "Picky", "Picky yielded nothing for this input"),
    ]
    assert found.rejections[1].requested == {"gain": 1}
    assert found.rejections[1].inputs == {"noise": 2}


def test_steps_give_the_same_as_instantiate():
    chain = family_of(noise(1, 2), noise(3))
    growth = growth_of(chain)
    for step in chain.producers:
        inputs = growth.inputs()
        assert len(inputs) == 1
        # Tasks may be done in any order.
        growth.join({key: evaluate(step, value) for key, value in reversed(inputs.items())})
    assert instantiation_of(Campaign((chain,)), [growth.grown()]).configurations == configurations(chain)


def test_provenance_and_steps_are_kept_beside_the_scenario(picky):
    chain = Family("rooms", {"noise": 1}, {}, (picky,))
    one, other = configurations(chain)
    assert (one.provenance, other.provenance) == ({}, {"_why": "odd"})
    assert [(step.producer, step.keys) for step in other.steps] == [("Picky", ("gain", "_why"))]
    assert "_why" not in other.factors
    assert other.scenario.task == {"gain": 2}


def test_producer_and_the_file_tag_dimensions():
    tagged = {"ParameterVariationList": {"name": "a", "values": [1], "dimension": "task"}}
    (only,) = configurations(family_of(tagged, values={"b": 2, "c": 3}, dimensions={"b": "environment"}))
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
    (only,) = configurations(family_of(values=values), abstract=abstract)
    assert only.scenario.abstract == expected


def test_duplicates_are_found_across_families():
    found = configurations(family_of(noise(1, 2, 1)), family_of(noise(2), name="again"))
    assert [(c.name, c.duplicate_of) for c in found] == [
        ("rooms-1", None),
        ("rooms-2", None),
        ("rooms-3", "rooms-1"),
        ("again-1", "rooms-2"),
    ]


def test_empty_placements_are_duplicates(hall):
    none = {"ObstacleVariation": {"obstacle_configs": [{"amount": 0, "max_distance": 0.3}], "count": 3}}
    found = configurations(family_of(paths(), none, values={"map_file": hall}))
    assert [c.duplicate_of for c in found] == [None, "rooms-1-1", "rooms-1-1"]


def test_same_seed_gives_the_same_paths_and_obstacles_whatever_else_varies(hall):
    values = {"map_file": hall}
    obstacles = {"ObstacleVariation": {"obstacle_configs": [{"amount": 3, "max_distance": 0.5}], "seed": 4}}
    alone = configurations(family_of(paths(num_paths=2), obstacles, values=values))
    after = configurations(family_of(noise(1, 2), paths(num_paths=2), obstacles, values=values))
    before = configurations(
        family_of(paths(num_paths=2), noise(1, 2, 3), obstacles, values={**values, "robot_radius": 0.2})
    )
    parts = [(c.scenario.task, c.scenario.environment) for c in alone]
    assert [(c.scenario.task, c.scenario.environment) for c in after] == parts * 2
    assert [(c.scenario.task, c.scenario.environment) for c in before] == [part for part in parts for _ in range(3)]


def test_drawn_configuration_is_pinned(hall):
    obstacles = {"ObstacleVariation": {"obstacle_configs": [{"amount": 2, "max_distance": 0.5}], "seed": 4}}
    (only,) = configurations(family_of(paths(seed=42), obstacles, values={"map_file": hall}))
    assert only.scenario.digest == "d31ad8fdd3c288853e8416dede4b1a6b94e35915d3f36381090f2e157e2aef27"


@each_row(
    ("item", "tag", "message"),
    [
        ({"gain": 1}, None, r"Loose yields a dict; Fragment\(\{key: value\}\) or Rejection\(reason\)"),
        (Fragment({"loss": 1}), None, "Loose writes 'loss', which it does not declare; every key in `writes`"),
        (
            Fragment({"gain": [{"spawn_pose": {"x": 1, "y": 1}}]}),
            "task",
            "Loose writes obstacles under 'gain' as task, where no simulator looks for them; environment",
        ),
    ],
)
def test_items_of_a_producer_are_checked(item, tag, message):
    class Loose(Picky):
        @property
        def writes(self):
            return {"gain": tag}

        def produce(self, inputs, draws):
            yield item

    with pytest.raises(PlugInError, match=message):
        evaluate(Loose(producer_module.Parameters()), {"noise": 1})


@each_row(
    ("declared", "message"),
    [
        ({"writes": {"gain": "world"}}, "Odd writes 'gain' as 'world'; one of environment, task, system, or None"),
        ({"reads": "noise"}, r"Odd reads the text 'noise'; a tuple of keys, \('noise',\)"),
    ],
)
def test_declarations_of_a_producer_are_checked(declared, message):
    odd = type("Odd", (Picky,), declared)(producer_module.Parameters())
    with pytest.raises(PlugInError, match=message):
        check_declared(odd)
