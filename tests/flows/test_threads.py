"""Several calls at once in one process: `tests/proofs/threads.py` in short."""

import pytest
import threads

from vastflow.sim.scenario.language import declaring, grammar


@pytest.mark.parametrize("way", ["threads", "asyncio.to_thread"])
def test_calls_at_once_load_shared_plug_ins_and_scenarios_without_failures(tmp_path, monkeypatch, way):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    grammar._parser.cache_clear()
    declaring._library.cache_clear()
    assert not threads.failures(tmp_path, threads.read, threads.WAYS[way], rounds=3)


@pytest.mark.timeout(300)
def test_prefect_tasks_at_once_load_shared_plug_ins_without_failures(tmp_path, started_api):
    with started_api(tmp_path / "prefect", tmp_path / "log"):
        assert not threads.failures(tmp_path, threads.read, threads.WAYS["Prefect tasks"], rounds=2)
