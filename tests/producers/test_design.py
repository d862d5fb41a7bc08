"""Designs of families, from producers to configurations."""

import itertools
from collections.abc import Iterator

import pytest
from families import Campaign, family, grown, levels
from table import each_row

from vastflow.producers.campaign_file.sections import CARTESIAN, DesignSpec, Sample, TWay
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Parameters, Producer


def two_way(strength=2):
    return DesignSpec(t_way=TWay(strength=strength))


def sample(size, method="lhs", seed=0):
    return DesignSpec(sample=Sample(method=method, size=size, seed=seed))


class Paths(Producer[Parameters]):
    """Three paths on map 1, two of them on map 2, and one path on map 3."""

    Parameters = Parameters
    reads = ("map",)
    writes = {"path": "task"}  # noqa: RUF012

    def produce(self, inputs, draws) -> Iterator[Fragment | Rejection]:
        for k in range(1 if inputs["map"] == 3 else 3):
            if inputs["map"] == 2 and k == 1:
                yield Rejection("no such path", {"k": k})
            else:
                yield Fragment({"path": f"{inputs['map']}{'abc'[k]}", "_k": k})


def chain():
    return levels("map", 1, 2, 3), levels("noise", 0, 1, 2), Paths(Parameters()), levels("radius", 1, 2)


def test_design_is_a_part_of_the_full_product_under_the_same_names():
    whole = {c.name: c.scenario for c in grown(*chain(), design=CARTESIAN).configurations}
    for design in (two_way(), sample(12)):
        found = {c.name: c.scenario for c in grown(*chain(), design=design).configurations}
        assert len(found) < len(whole)
        assert found.items() <= whole.items()


def test_t_way_covers_all_pairs_of_dependent_producers():
    def pairs(design):
        found = grown(*chain(), design=design).configurations
        choices = [tuple(step.choice for step in c.steps) for c in found]
        return {(i, j, c[i], c[j]) for c in choices for i, j in itertools.combinations(range(4), 2)}

    assert pairs(two_way()) == pairs(CARTESIAN)


def test_unrealizable_choice_is_reported_once_and_replaced():
    found = grown(*chain(), design=two_way())
    assert [(r.parent, r.reason) for r in found.rejections] == [("rooms-2-*", "no such path")]
    counted = found.coverage["families"]["rooms"]
    assert counted["t_way"]["share"] == 1.0
    (pair,) = [p for p in counted["t_way"]["pairs"] if p["factors"] == ["map", "path"]]
    assert (pair["combinations"], pair["admissible"], pair["covered"]) == (9, 6, 6)


def test_size_is_reported_against_the_product_and_a_lower_bound():
    ten = [levels(f"k{i}", 1, 2, 3, 4) for i in range(10)]
    found = grown(*ten, design=two_way())
    design = found.coverage["families"]["rooms"]["design"]
    assert design == {"kind": "t_way", "strength": 2, "rows": design["rows"], "product": 4**10, "lower_bound": 16}
    assert 16 <= design["rows"] == len(found.configurations) <= 32


@each_row("design", [two_way(), two_way(3), sample(30, "sobol")])
def test_constraints_restrict_covering_design(design):
    found = grown(*(levels(n, 1, 2, 3) for n in "abcd"), design=design, up="a <= b and b <= c", not_all="a + d < 6")
    for c in found.configurations:
        f = c.factors
        assert f["a"] <= f["b"] <= f["c"] and f["a"] + f["d"] < 6
    part = found.coverage["families"]["rooms"]
    assert part["valid"] == sum(a <= b <= c and a + d < 6 for a, b, c, d in itertools.product((1, 2, 3), repeat=4))
    if design.t_way is not None:
        assert part["t_way"]["share"] == 1.0


def test_sample_does_not_depend_on_other_families():
    alone = grown(*chain(), design=sample(9))
    with_others = instantiate(
        Campaign((family(levels("map", 7), design=two_way(), name="first"), family(*chain(), design=sample(9))))
    )
    assert with_others.configurations[1:] == alone.configurations


@each_row("method", ["lhs", "sobol"])
def test_sample_of_an_enormous_product_is_made_at_once(method):
    many = [levels(f"k{i}", *range(10)) for i in range(20)]
    found = grown(*many, design=sample(50, method))
    assert len({c.scenario.digest for c in found.configurations}) == 50
    assert found.coverage["valid"] == 10**20


def test_family_without_producers_is_one_scenario():
    for design in (two_way(), sample(5)):
        assert [c.name for c in grown(design=design).configurations] == ["rooms"]


def test_numbers_of_a_design_add_up():
    found = grown(*chain(), design=two_way(), apart="noise != 0 or path != '1a'")
    assert all(c.factors["noise"] or c.factors["path"] != "1a" for c in found.configurations)
    assert [e.name for e in found.excluded] == ["rooms-1-1-1"]
    part = found.coverage
    assert part["requested"] == part["excluded"] + part["unrealizable"] + part["duplicate"] + part["realized"]
    # 6 paths on 3 maps × 3 noises × 2 radii, less the 2 of the excluded path and noise; and what could not be built.
    assert part["valid"] == 6 * 3 * 2 - 2 + 1
    assert part["share"] == pytest.approx(part["realized"] / part["valid"])
