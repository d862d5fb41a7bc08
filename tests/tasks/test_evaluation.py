import pickle
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.producers.catalog.one_of import OneOfVariation
from vastflow.producers.catalog.parameter import ParameterVariationList
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import find_producer
from vastflow.sim.model.digest import FileContent
from vastflow.tasks.engine.evaluation import (
    content_of,
    evaluation_keys,
    files_in,
    packed,
    read_evaluation,
    write_evaluation,
)
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.store import Lost

KEYS = Keys("numeric", "e", "o", "j", 0, [])
OWN = """
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import Parameters, Producer

class OwnParameters(Parameters):
    values: tuple[float, ...]

class Own(Producer[OwnParameters]):
    Parameters = OwnParameters
    reads = ()
    writes = {"x": None}
    def produce(self, inputs, draws):
        for value in self.parameters.values:
            yield Fragment({"x": value})
"""

text = st.text(max_size=3)
scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | text
nested = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=2) | st.dictionaries(text, inner, max_size=2), max_leaves=4
)
values = st.dictionaries(text, nested, max_size=2)


@given(st.lists(values.map(Fragment) | st.builds(Rejection, text, values), max_size=3))
def test_evaluation_is_read_back_bit_for_bit(results):
    assert read_evaluation(write_evaluation(results), {}) == results


def test_evaluation_with_nan_is_refused():
    with pytest.raises(ValueError, match="expected a number, got NaN"):
        write_evaluation([Fragment({"a": [float("nan")]})])


def test_whole_number_and_a_float_stay_apart():
    (fragment,) = read_evaluation(write_evaluation([Fragment({"a": 1, "b": 1.0})]), {})
    assert [type(value) for value in fragment.values.values()] == [int, float]


def test_file_is_where_this_campaign_has_it(tmp_path):
    here = tmp_path / "here.yaml"
    here.touch()
    content = write_evaluation([Fragment({"map_file": FileContent("/gone/map.yaml", "d")})])
    (fragment,) = read_evaluation(content, {"d": str(here)})
    assert fragment.values["map_file"].path == str(here)


def test_file_missing_everywhere_is_recreated():
    content = write_evaluation([Fragment({"map_file": FileContent("/gone/map.yaml", "d")})])
    with pytest.raises(Lost, match=r"/gone/map\.yaml"):
        read_evaluation(content, {})


def test_files_are_found_in_values_and_parameters():
    producer = listed(name="mesh_file", values=[{"a": FileContent("/m", "d")}])
    assert files_in({"x": [FileContent("/p", "e")]}, producer.parameters) == {"e": "/p", "d": "/m"}


def listed(**parameters):
    return ParameterVariationList(ParameterVariationList.Parameters.model_construct(**parameters))


def keys_of(producer, *inputs):
    return list(evaluation_keys(KEYS, installed_tree(), producer, {key: {} for key in inputs}).values())


def test_parameters_and_inputs_are_in_the_key():
    assert keys_of(listed(name="a", values=[1]), "1" * 64) != keys_of(listed(name="a", values=[2]), "1" * 64)
    assert keys_of(listed(name="a", values=[1]), "1" * 64) != keys_of(listed(name="a", values=[1]), "2" * 64)


def test_order_of_a_mapping_is_in_the_content():
    """A plug-in may go through its parameters in the order of the file."""
    assert content_of({"b": 1, "a": [{"d": 1, "c": 2}]}) == [{"b": 1}, {"a": [[{"d": 1}, {"c": 2}]]}]
    assert content_of({"a": 1, "b": 2}) == {"a": 1, "b": 2}


def test_files_place_is_not_in_the_key():
    one, other = (listed(name="a", values=[FileContent(path, "d")]) for path in ("/one", "/other"))
    assert keys_of(one, "1" * 64) == keys_of(other, "1" * 64)


def own(folder, text=OWN, **parameters):
    (folder / "own.py").write_text(text)
    kind = find_producer("own.py:Own", folder)
    return kind(kind.Parameters(**parameters))


def one_of(*children):
    return OneOfVariation(OneOfVariation.Parameters(variations=list(children)))


def test_alternatives_depend_on_producers_and_parameters(tmp_path):
    alternatives = one_of(listed(name="a", values=(1, 2)), own(tmp_path, values=(1.0,)))
    assert content_of(alternatives.parameters) == {
        "dimension": None,
        "variations": [
            {"ParameterVariationList": {"dimension": None, "name": "a", "values": [1, 2]}},
            {"Own": {"dimension": None, "values": [1.0]}},
        ],
    }


def test_edited_custom_alternative_is_reevaluated(tmp_path):
    plain, edited = (
        keys_of(one_of(own(tmp_path, text, values=(1.0,))), "1" * 64)
        for text in (OWN, OWN.replace("value})", "value + 1})"))
    )
    assert plain != edited


def test_custom_alternatives_are_pickled(tmp_path):
    sent = pickle.dumps(packed(one_of(one_of(own(tmp_path, values=(1.0, 2.0))))))
    script = "import pickle, sys; print(pickle.loads(sys.stdin.buffer.read()).unpacked().children[0].children[0].parameters.values)"
    done = subprocess.run([sys.executable, "-c", script], input=sent, capture_output=True, timeout=240, check=True)
    assert done.stdout.decode().strip() == "(1.0, 2.0)"
