"""Workers and schedulers that answer pickles, and other users of this machine."""

import os

import pytest
from distributed.protocol import dumps, to_serialize
from distributed.protocol.serialize import ToPickle
from hostile_cluster import WAYS, HostileCluster, exposed, intrude, local_cluster

from vastflow.tasks.engine.dask_client import pickled_error, plain_message
from vastflow.tasks.engine.dask_worker import Answer, read_answer, write_answer
from vastflow.tasks.engine.work import Broken, Executed
from vastflow.tasks.store.store import open_store

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    cluster = HostileCluster(tmp_path_factory.mktemp("hostile"))
    yield cluster
    cluster.close()


@pytest.mark.parametrize("way", WAYS)
def test_campaign_unpickles_nothing_of_hostile_cluster(hostile, way):
    executed, outcome = hostile.attack(way)
    assert not executed, outcome


def test_unit_with_pickle_for_answer_is_refused_in_a_sentence(hostile):
    _, outcome = hostile.attack("result")
    assert str(outcome).startswith("a worker answered something else than this vastflow does (")


def test_local_cluster_executes_nothing_for_other_users(tmp_path):
    if os.getuid():
        pytest.skip("expected root, which can become another user")
    executor = local_cluster(tmp_path)
    try:
        assert (intrude(executor._address), exposed()) == ("", [])
    finally:
        executor.close()


def test_message_has_text_in_place_of_all_bytes():
    message = {"a": b"\x80", "b": [b"x", {"c": bytearray(b"y")}], "d": to_serialize(b"z" * 3), "type": b"gone"}
    frames = [bytes(each) for each in dumps({**message, "e": ToPickle(print), "f": to_serialize(print), "g": {1}})]
    read = plain_message(frames)
    assert (read["a"], read["b"], read["d"], read["g"]) == ("\x80", ("x", {"c": "y"}), "zzz", {1})
    assert isinstance(read["f"], str) and read["e"] == "" and "type" not in read


def test_error_is_told_by_its_pickle_without_executing_it():
    import pickle

    assert pickled_error(pickle.dumps(OSError("no route to host")).decode("latin-1")) == ("OSError", "no route to host")
    assert pickled_error("no pickle") == ("Exception", "")


def test_answer_comes_back_as_it_was(tmp_path):
    store = open_store(tmp_path)
    artifact = store.put("judge/ab/0-2", {"verdicts.json": b"[]"}, {"runs": [[0, "pass"], [1, "fail"]], "causes": []})
    executed = Executed({0: 0.1 + 0.2, 1: 3.0}, {2: Broken("lost", True)}, 1.5, (artifact,))
    assert read_answer(write_answer(Answer(executed=executed))) == Answer(executed=executed)


@pytest.mark.parametrize("key", ["../judge/ab", "/judge/ab", ""])
def test_answer_with_artifact_outside_of_the_store_is_refused(tmp_path, key):
    artifact = open_store(tmp_path, read_only=True).put(key, {"x": b""})
    with pytest.raises(ValueError, match="expected a path inside the folder"):
        read_answer(write_answer(Answer(executed=Executed({}, {}, artifacts=(artifact,)))))
