import subprocess
import sys

import pytest

from vastflow.flows import run_campaign
from vastflow.sim.model.faults import FileError

pytestmark = pytest.mark.timeout(900)


def loaded_after(statement):
    script = f"{statement}; import sys; print(*[name for name in ('numba', 'prefect') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    return done.stdout.split()


def test_importing_the_package_imports_neither_prefect_nor_numba():
    assert loaded_after("import vastflow.flows") == []


def test_api_does_not_import_prefect_until_it_is_needed():
    assert "prefect" not in loaded_after("from vastflow.flows import run_campaign")


def test_worker_functions_import_neither_prefect_nor_numba():
    assert loaded_after("import vastflow.tasks.engine.work, vastflow.tasks.engine.pool") == []


def test_fewer_than_one_run_is_refused(tmp_path):
    with pytest.raises(ValueError, match="runs is at least 1, got 0"):
        run_campaign(tmp_path / "x.vast", runs=0)


def test_bad_campaign_file_writes_nothing(tmp_path):
    (tmp_path / "x.vast").write_text("version: 1\nconfiguraton: []\n")
    with pytest.raises(FileError, match=r"x\.vast:2:1: .*did you mean 'configuration'"):
        run_campaign(tmp_path / "x.vast", results=tmp_path / "results", store=tmp_path / "store")
    assert [file.name for file in tmp_path.iterdir()] == ["x.vast"]
