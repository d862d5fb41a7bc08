"""Coverage of the test space."""

import json

from families import grown, levels
from table import each_row

from vastflow.producers.instantiation.coverage import MOST_LISTED
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import Parameters, Producer


class Wide(Producer[Parameters]):
    """Rejects even `a`, each with its own reason."""

    Parameters = Parameters
    reads = ("a",)
    writes = {"b": "environment"}  # noqa: RUF012

    def produce(self, inputs, draws):
        yield Fragment({"b": 1}) if inputs["a"] % 2 else Rejection(f"no room for {inputs['a']}")


def coverage(*producers, **constraints):
    return grown(*producers, **constraints).coverage


def test_instances_are_counted_once_with_their_cause():
    found = coverage(levels("a", 1, 1, 2, 3, 4, 5), Wide(Parameters()), small="a < 5")
    names = ("requested", "excluded", "unrealizable", "duplicate", "realized", "valid", "share")
    assert [found[name] for name in names] == [6, 1, 2, 1, 2, 4, 0.5]
    assert found["excluded_by"] == {"small": 1}
    assert found["unrealizable_by"]["Wide"]["reasons"] == {"no room for 2": 1, "no room for 4": 1}
    assert coverage(levels("a", 2, 4), Wide(Parameters()))["share"] == 0.0


def test_dimensions_count_distinct_contents_and_choices():
    whole = coverage(levels("a", 1, 2, 3), Wide(Parameters()), levels("loops", 1, 2, dimension="task"))
    found = whole["families"]["rooms"]["dimensions"]
    assert {name: each["distinct"] for name, each in found.items()} == {"environment": 1, "task": 2, "system": 2}
    counts = {"combinations": 3, "admissible": 2, "covered": 2, "share": 1.0}
    assert found["system"] == {"factors": ["a"], "distinct": 2, **counts}


def test_pairs_of_choices_are_counted():
    found = coverage(levels("a", 1, 2, 3), levels("b", 1, 2), levels("c", 1), other="a != 1 or b != 1")
    counts = {"combinations": 6, "admissible": 5, "covered": 5, "share": 1.0}
    assert found["families"]["rooms"]["t_way"]["pairs"] == [{"factors": ["a", "b"], **counts}]


def test_coverage_stays_readable_with_many_choices():
    found = coverage(
        *(levels(f"k{i}", *range(1, 2 + (i < 3))) for i in range(30)), levels("a", *range(2, 600)), Wide(Parameters())
    )
    wide = found["families"]["rooms"]["unrealizable_by"]["Wide"]
    assert len(wide["reasons"]) == MOST_LISTED
    assert wide["reasons_not_listed"] == 299 - MOST_LISTED
    assert len(json.dumps(found, indent=2)) < 60_000


@each_row("constrained", [False, True])
def test_twenty_thousand_configurations_of_parameters_take_a_second_or_two(constrained, loops):
    sizes = (10, 10, 10, 20)
    text = {"sum": "k0 + k1 >= 0 and k2 < 100"} if constrained else {}
    producers = [levels(f"k{i}", *map(float, range(n))) for i, n in enumerate(sizes)]
    found = []
    assert loops(lambda: found.append(coverage(*producers, **text)), 1) < 300
    assert found[0]["realized"] == 20_000
