"""The Variation DSL: documented numbers, and faults of files that vary a missing element."""

from pathlib import Path

import numpy as np
import pytest
from floor_plans import EXAMPLE as PLAN
from floor_plans import built
from table import each_row

from vastflow.producers.floorplan.files import read_variation_file
from vastflow.producers.floorplan.rendering import geometry_of
from vastflow.producers.floorplan.syntax import parse
from vastflow.producers.floorplan.variation import Distribution, parse_variation, variation_of
from vastflow.sim.model.faults import FileError

FILE = Path(__file__).with_name("test_floorplan_example.variation")
HEAD = 'import "flat.fpm"\n'


def variation(items, plan=PLAN):
    return variation_of(parse_variation(HEAD + items, "v.variation"), parse(plan, "flat.fpm"))


def complaints(items, plan=PLAN):
    with pytest.raises(FileError) as caught:
        variation(items, plan)
    return str(caught.value).splitlines()


@each_row(
    ("seed", "numbers"),
    [(7, (0.7, 0.3, 0.34, 0.6, -0.05)), (8, (0.7, 0.3, 0.02, 0.6, 0.11)), (9, (1.1, 0.1, -0.05, 0.6, -0.0))],
)
def test_documented_seeds_give_the_documented_numbers(seed, numbers):
    sample = read_variation_file(FILE).variation().sample(seed)
    assert dict(sample.values) == dict(
        zip(
            ("gap", "study.defaults.wall.thickness", "study.location.translation.x", "study.post.height",
             "door.location.translation.x"), numbers, strict=True)
    )  # fmt: skip


def test_sample_text_has_plan_seed_and_drawn_numbers():
    sample = read_variation_file(FILE).variation().sample(7)
    first, second, *rest = sample.text.splitlines()
    assert first.startswith("// ") and "flat" in first
    assert second == "// Seed 7"
    changes = {(old.strip(), new.strip()) for old, new in zip(PLAN.splitlines(), rest, strict=True) if old != new}
    assert changes == {
        ("var gap = 0.9 m", "var gap = 0.7 m"),
        ("translation: x: 0.25 m", "translation: x: 0.34 m"),
        ("height: 2.0 m", "height: 0.6 m"),
        ("translation: x: -0.1 m, z: 1.0 m", "translation: x: -0.05 m, z: 1.0 m"),
    }


def test_varied_plan_with_features_is_built():
    # Upstream's writer loses `of: this.walls[0]` and writes features that its parser refuses.
    geometry = geometry_of(built(read_variation_file(FILE).variation().sample(9).text))
    assert geometry["obstacles"]["post"]["height"] == 0.6
    assert geometry["walls"]["study-wall-0"]["polygon"][0][0] == pytest.approx(4.2)
    assert geometry["spaces"]["study"][0] == pytest.approx((4.3, 3.05))


def test_variation_numbers_follow_file_order():
    one = variation("gap : uniform([1, 2, 3, 4, 5])\nstudy.post: { height : uniform([1, 2, 3, 4, 5]) }").sample(1)
    other = variation("study.post: { height : uniform([1, 2, 3, 4, 5]) }\ngap : uniform([1, 2, 3, 4, 5])").sample(1)
    assert list(one.values.values()) == list(other.values.values())
    assert list(one.values) == ["gap", "study.post.height"]


def test_angle_written_in_degrees_is_drawn_in_degrees():
    assert "var tilt = 45.0 deg" in variation("tilt : uniform([45])").sample(0).text


def test_probabilities_that_add_up_to_one_but_for_rounding_are_accepted():
    assert variation("gap : discrete([(0.1, 1), (0.2, 2), (0.7, 3)])").sample(0).values["gap"] in (1, 2, 3)


def test_faults_of_a_variation_have_place_and_message(golden):
    golden("floor_plans", "variation", complaints)


def test_name_that_two_things_have_can_not_be_varied():
    plan = PLAN.replace("Window pane", "Window corridor")
    (only,) = complaints("corridor: { shape.width : uniform([1]) }", plan)
    assert "The plan has more than one 'corridor'" in only


def test_missing_import_is_a_fault_of_variation_file(tmp_path):
    (tmp_path / "v.variation").write_text('// a comment\nimport "none.fpm"\ngap : uniform([1])\n')
    with pytest.raises(FileError, match=r"v\.variation:2:8: import: '.*none\.fpm': No such file"):
        read_variation_file(tmp_path / "v.variation")


def test_fault_in_imported_plan_names_the_plan(tmp_path):
    (tmp_path / "flat.fpm").write_text(PLAN.replace("width=gap", "width=gab"))
    (tmp_path / "v.variation").write_text(f"{HEAD}gap : uniform([1])")
    with pytest.raises(
        FileError, match=r"flat\.fpm:41:32: Entryway door: Unknown variable 'gab'\. Did you mean 'gap'\?"
    ):
        read_variation_file(tmp_path / "v.variation").variation()


def test_standard_deviation_of_minus_zero_is_zero():
    assert Distribution("normal", (7.7, -0.0)).draw(np.random.RandomState(0)) == 7.7
