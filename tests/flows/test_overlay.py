"""A store that a dry run reads from and writes nothing to."""

import pytest

from vastflow.flows.plan.store import Overlay, untouched
from vastflow.tasks.store import Lost


def test_what_is_put_over_a_store_is_not_in_it(tmp_path):
    overlay = Overlay(untouched(str(tmp_path / "store")))
    artifact = overlay.put("evaluate/aa/aa", {"x": b"1"})
    assert overlay.read("evaluate/aa/aa", "x") == b"1"
    assert overlay.find("evaluate/aa/aa") == artifact
    with pytest.raises(Lost, match="evaluate/bb/bb: x is not in the store"):
        overlay.read("evaluate/bb/bb", "x")
    assert not (tmp_path / "store").exists()
