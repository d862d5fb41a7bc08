"""The selection of a campaign: by name, and as a sample."""

from collections import Counter
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.flows.request.configurations import narrowed, sampled
from vastflow.producers.instantiation.instantiate import Instantiation, mark_duplicates
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.scenario import ProcessSetup, scenario_of
from vastflow.tasks.engine.instantiation import Instantiated

FILE = "campaign.vast"


def instantiation(**families: list[int]) -> Instantiation:
    """Configurations of these families; equal numbers are equal content."""
    configurations = [
        Configuration(
            f"{family}-{k}", family, scenario_of({"number": number}, {}, abstract="", timeout_s=1.0), {}, {}, ()
        )
        for family, numbers in families.items()
        for k, number in enumerate(numbers, 1)
    ]
    return Instantiation(tuple(mark_duplicates(configurations)), (), (), {})


def names(found: Instantiation) -> list[str]:
    return [each.name for each in found.configurations]


def distinct(found: Instantiation) -> set[str]:
    return {each.name for each in found.configurations if each.duplicate_of is None}


LARGE = instantiation(a=list(range(60)), b=list(range(100, 130)), c=list(range(200, 210)))


@given(st.integers(1, 110), st.integers(1, 110), st.integers(0, 3))
def test_larger_sample_contains_a_smaller_one(one, other, seed):
    small, large = sorted((one, other))
    assert distinct(sampled(LARGE, small, seed)) <= distinct(sampled(LARGE, large, seed))


@given(st.integers(1, 100), st.integers(0, 3))
def test_sample_has_each_family_in_proportion(size, seed):
    shares = Counter(each.family for each in sampled(LARGE, size, seed).configurations)
    for family, of in (("a", 60), ("b", 30), ("c", 10)):
        assert abs(shares[family] - size * of / 100) <= 1


@each_row(("size", "seats"), [(12, {"a": 12}), (13, {"a": 12, "b": 1}), (38, {"a": 36, "b": 2})])
def test_sample_rounds_shares_by_websters_method(size, seats):
    """The first of the small family has the place 0.5 / 4, between the large one's 12th and 13th."""
    found = sampled(instantiation(a=list(range(96)), b=list(range(100, 104))), size, 0)
    assert Counter(each.family for each in found.configurations) == seats


def test_sample_depends_on_content_and_seed_only():
    renamed = instantiation(z=list(reversed(range(60))))
    plain = instantiation(a=list(range(60)))

    def digests(found):
        return {each.scenario.digest for each in found.configurations}

    assert digests(sampled(renamed, 20, 1)) == digests(sampled(plain, 20, 1)) != digests(sampled(plain, 20, 2))


def test_sample_is_the_same_for_nodes_and_the_built_in_robot():
    driven = [
        replace(each, scenario=replace(each.scenario, programs=ProcessSetup(nodes=Nodes())))
        for each in LARGE.configurations
    ]
    assert names(sampled(replace(LARGE, configurations=tuple(driven)), 20, 1)) == names(sampled(LARGE, 20, 1))


def test_new_configuration_replaces_at_most_one_of_sample():
    before, after = instantiation(a=list(range(60))), instantiation(a=[*range(60), 99])
    assert len(distinct(sampled(before, 20, 1)) - distinct(sampled(after, 20, 1))) <= 1


def test_sample_keeps_order_and_duplicates():
    found = sampled(instantiation(a=[5, 6, 7, 5, 6, 5]), 1, 0)
    assert len(distinct(found)) == 1
    (first, *others) = found.configurations
    assert {each.duplicate_of for each in others} <= {first.name}
    assert len(names(found)) == {"a-1": 3, "a-2": 2, "a-3": 1}[first.name]
    assert found.sampled_from == 3


def test_selection_is_everything_by_default_and_for_larger_sample():
    assert names(sampled(LARGE, 1000, 0)) == names(LARGE)
    assert narrowed(Instantiated(LARGE), FILE).instantiation is LARGE
    assert LARGE.sampled_from is None


def test_sample_is_drawn_from_selected_names():
    found = narrowed(Instantiated(LARGE), FILE, ["b"], 7).instantiation
    assert (len(names(found)), found.sampled_from) == (7, 30)
    assert {each.family for each in found.configurations} == {"b"}
