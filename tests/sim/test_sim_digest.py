"""Digests: pinned, because a digest that changes its meaning serves stale results or computes everything again."""

import hashlib
import os
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.digest import FileContent, canonical, digest, file_digest
from vastflow.sim.model.scenario import Scenario, scenario_of

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@each_row(
    ("value", "text"),
    [
        (None, "[null]"),
        (True, "[true]"),
        (1, "[1]"),
        (1.0, '[{"float":"0x1.0000000000000p+0"}]'),
        (0.1, '[{"float":"0x1.999999999999ap-4"}]'),
        (float("inf"), '[{"float":"inf"}]'),
        ("1", '["1"]'),
        ("ä", '["\\u00e4"]'),
        ((1, "a"), '[[1,"a"]]'),
        ({"b": 1, "a": 2.0}, '[{"map":{"a":{"float":"0x1.0000000000000p+1"},"b":1}}]'),
        (FileContent("anywhere", "00ff"), '[{"file":"00ff"}]'),
    ],
)
def test_canonical_text_of_a_value_is_pinned(value, text):
    assert canonical([value]) == text


def test_digest_is_pinned():
    value = {"a": [None, True, 1, 1.0, "x"], "f": FileContent("p", "ab"), "m": {"k": -0.5}}
    assert digest(value) == "e02165f78da9cb46bc09e87f968a6ec0e1b1c8e1bab756ed8b0018d39c863c6b"
    assert digest() == "4f53cda18c2baa0c0354bb5f9a3ecbe5ed12ab4d8e11ba873c2f11161202b945"


@each_row(
    "values",
    [
        [1, 1.0, True],
        ["1", 1, None, "None", "null"],
        [{"float": (1.0).hex()}, 1.0],
        [{"file": "ab"}, FileContent("p", "ab")],
    ],
)
def test_different_values_have_different_digests(values):
    assert len({digest(value) for value in values}) == len(values)
    assert digest(*values) != digest(values)
    assert digest(-0.0) == digest(0.0)


@each_row(
    ("value", "error", "message"),
    [
        ({"a": [float("nan")]}, ValueError, "NaN has no digest"),
        ({1: 2}, TypeError, "key must be text, got 1"),
        *((value, TypeError, "has no canonical form. Use None, bool, int") for value in ({1, 2}, b"bytes", object())),
    ],
)
def test_value_without_a_canonical_form_is_refused(value, error, message):
    with pytest.raises(error, match=message):
        digest(value)


def test_digest_takes_file_by_content_not_place(tmp_path):
    def content(name, text):
        (tmp_path / name).write_bytes(text)
        return FileContent(str(tmp_path / name), file_digest(tmp_path / name))

    assert content("a", b"content") == content("b", b"content")
    assert digest(content("a", b"content")) == digest(content("b", b"content")) != digest(content("c", b"Content"))


@given(st.dictionaries(st.text(), VALUES, max_size=5))
def test_order_of_keys_does_not_matter(mapping):
    assert digest(dict(reversed(mapping.items()))) == digest(mapping)


FLOOR, START = {"map_file": FileContent("somewhere/map.yaml", "ab")}, {"start_pose": {"x": 1.0, "y": 2.0}}
SCENARIO = Scenario("builtin:navigate_to_pose", 60.0, FLOOR, START, {"robot_radius": 0.22})


def test_digests_of_a_scenario_and_its_situation_are_pinned():
    assert SCENARIO.digest == "a202318e9758f97ead10a6a262317279a9abb237789033287637fb95fe10f9ab"
    assert SCENARIO.situation_digest == "bcc541ce17c8653f67bfdb1a8ed29df0e5289900fb3d77bd87469f61994618e0"


@each_row(
    ("change", "is_of_the_situation"),
    [
        ({"abstract": "builtin:follow_waypoints"}, False),
        ({"timeout_s": 61.0}, False),
        ({"environment": {}}, True),
        ({"task": {}}, True),
        ({"system": {}}, False),
    ],
)
def test_parts_of_a_scenario_are_in_its_digests(change, is_of_the_situation):
    other = replace(SCENARIO, **change)
    assert other.digest != SCENARIO.digest
    assert (other.situation_digest != SCENARIO.situation_digest) == is_of_the_situation


def test_values_are_sorted_into_dimensions_by_tag_and_key():
    values = {"map_file": "m", "goal_pose": "g", "noise": 0.1, "crates": [], "start_pose": "s", "_path": []}
    tags = {"crates": "environment", "start_pose": "system"}
    scenario = scenario_of(values, tags, abstract="builtin:navigate_to_pose", timeout_s=1.0)
    assert scenario.environment == {"map_file": "m", "crates": []}
    assert scenario.task == {"goal_pose": "g"}
    assert scenario.system == {"noise": 0.1, "start_pose": "s"}


@pytest.mark.timeout(60)
def test_digest_of_a_file_that_never_ends_is_that_of_an_empty_one():
    if not os.access("/proc/kmsg", os.R_OK):
        pytest.skip("takes a user who may read /proc/kmsg")
    assert file_digest("/proc/kmsg") == hashlib.sha256(b"").hexdigest()
