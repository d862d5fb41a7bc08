"""Campaigns on a machine that lacks something, and the same call when it is mended."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

GROWTH = Path(__file__).parents[2] / "campaigns" / "growth"


def may_unshare():
    tools = all(map(shutil.which, ("unshare", "setpriv", "mount")))
    return tools and os.geteuid() == 0 and subprocess.run(["unshare", "-m", "true"], check=False).returncode == 0


pytestmark = [pytest.mark.slow, pytest.mark.skipif(not may_unshare(), reason="needs root and mount namespaces")]
READ_ONLY, FULL = (f"mkdir -p {{}} && mount -t tmpfs -o {option} none {{}}" for option in ("ro", "size=16k"))


@pytest.fixture
def lab():
    """A folder that is not below pytest's, which are for its user alone."""
    with TemporaryDirectory(prefix="vastflow-lab-") as folder:
        yield Path(folder)


def run(lab, *prefix, **environment):
    """A call of the command line in a folder, by way of a program that spoils the machine before."""
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", lab / "growth" / "growth.vast"]
    options = ["--workers", "1", "--json", "--store", lab / "store", "--results", lab / "results"]
    kept = {name: value for name, value in {**os.environ, **environment}.items() if value}
    return subprocess.run([*prefix, *command, *options], cwd=lab, env=kept, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("spoil", "user", "variables", "words"),
    [
        (READ_ONLY.format("home", "home"), 0, {"HOME": "home", "XDG_CACHE_HOME": ""}, "(Read-only file system). Set XDG_"),
        (READ_ONLY.format("/dev/shm", "/dev/shm"), 0, {}, "can't write to '/dev/shm' (Read-only file system)"),
        (FULL.format("store", "store"), 0, {}, "No space left on device"),
        (FULL.format("results", "results"), 0, {}, "(No space left on device). Make room"),
        ("mkdir store && chmod 755 store", 65534, {"XDG_CACHE_HOME": "cache", "PREFECT_HOME": "prefect"}, "store: can't write to"),
        ("mkdir -m 700 prefect", 65534, {"XDG_CACHE_HOME": "cache", "PREFECT_HOME": "prefect"}, "et PREFECT_HOME to a folder of"),
    ],
)  # fmt: skip
def test_campaign_names_defect_and_runs_when_mended(lab, spoil, user, variables, words):
    shutil.copytree(GROWTH, lab / "growth", ignore=shutil.ignore_patterns("__pycache__"))
    file = lab / "growth" / "growth.vast"
    text = file.read_text().replace("[0.5, 1.0, 2.0, 3.0, 4.0]", "[0.5]").replace("[1, 10, 100, 900]", "[10]")
    file.write_text(text)
    prefix = ["unshare", "-m", "sh", "-ec", f'{spoil} && exec "$@"', "sh"]
    if user:
        lab.chmod(0o777)
        as_nobody = ["setpriv", "--reuid", str(user), "--regid", str(user), "--clear-groups"]
        if subprocess.run([*as_nobody, sys.executable, "-c", ""], check=False).returncode:
            pytest.skip("another user may not run this Python")
        prefix += as_nobody
    spoiled = run(lab, *prefix, **{name: value and str(lab / value) for name, value in variables.items()})
    assert spoiled.returncode == 2, spoiled.stderr
    assert "Traceback" not in spoiled.stderr and words in spoiled.stderr
    assert not list(lab.glob("results/[!.]*/verdicts.parquet"))
    mended = run(lab)
    assert mended.returncode == 0, mended.stderr
    assert json.loads(mended.stdout)["passed"] == 1
