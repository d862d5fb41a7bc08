"""Differences between two campaigns, in words."""

from table import each_row

from vastflow.flows.results.provenance import changes_text


@each_row(
    ("then", "now", "words"),
    [
        ({"a": 1, "b": {"c": 2.0}}, {"a": 1, "b": {"c": 2.5}}, "b.c from 2.0 to 2.5"),
        ({"a": 1}, {"b": True}, "a from 1 to nothing, b from nothing to true"),
        ({"v": [1, 2]}, {"v": [3, 1, 2]}, "v gained 3"),
        ({"v": [1, 2]}, {"v": [2, 1]}, "v in another order or number"),
        ({"v": [{"x": 1, "y": 1}]}, {"v": [{"x": 2, "y": 1}]}, "v[0].x from 1 to 2"),
        ({"v": [1]}, {"v": [1, 2, 3, 4, 5, 6]}, "v gained 2, 3, 4 and 2 more"),
        ({"m": {"file": "a" * 64}}, {"m": {"file": "b" * 64}}, "m from file aaaaaaaaaaaa to file bbbbbbbbbbbb"),
        ({"n": 1}, {"n": 1.0}, "n from 1 to 1.0"),
    ],
)
def test_differences_are_put_in_words(then, now, words):
    assert changes_text(then, now) == words
