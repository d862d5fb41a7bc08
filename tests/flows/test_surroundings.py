"""Machines that lack something: `tests/proofs/environment.py` in short, with what is found before anything is started."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROOFS = Path(__file__).parents[1] / "proofs"


def _may_unshare() -> bool:
    tools = all(map(shutil.which, ("unshare", "setpriv", "mount")))
    return tools and os.geteuid() == 0 and subprocess.run(["unshare", "-m", "true"], check=False).returncode == 0


pytestmark = pytest.mark.skipif(not _may_unshare(), reason="needs root and mount namespaces")


@pytest.fixture(scope="module")
def environment():
    sys.path.insert(0, str(PROOFS))
    try:
        import environment

        yield environment
    finally:
        sys.path.remove(str(PROOFS))
        sys.modules.pop("environment", None)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["read-only home", "no /dev/shm", "another user's store"])
def test_defect_of_the_machine_is_reported_in_one_sentence(environment, tmp_path_factory, name):
    lab = environment.Lab(tmp_path_factory.mktemp("lab"))
    for parent in lab.folder.parents[
        : 2 + ("PYTEST_XDIST_WORKER" in os.environ)
    ]:  # pytest's own are for its user alone
        parent.chmod(0o755)
    lab.laid_out()
    (condition,) = (condition for condition in environment.CONDITIONS if condition.name == name)
    if (
        condition.user
        and subprocess.run(["setpriv", "--reuid", "65534", sys.executable, "-c", ""], check=False).returncode
    ):
        pytest.skip("another user may not run this Python")
    assert environment.refused(condition, lab) is None


def test_another_sentence_than_the_condition_s_is_found(environment, tmp_path):
    lab = environment.Lab(tmp_path)
    lab.laid_out()
    condition = environment.Condition("a file", "touch LAB/file", "never said", results="file")
    assert "it says" in (environment.refused(condition, lab) or "")
