"""The examples of the documentation run as they are."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
PRINTS = {
    "plot_localization_error": "localization_error.png",
    "slowest_runs": "s/m  vastflow replay ",
    "stricter_oracle": "robot radius 0.35 m: ",
    "success_by_noise": "report: ",
    "write_a_campaign": "6 configurations, 0 rejected",
}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_prints_its_result(example, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp() / "examples"  # one store and one server's home for all of them
    folder.mkdir(exist_ok=True)
    if not (folder / "campaigns").exists():
        (folder / "campaigns").symlink_to(ROOT / "campaigns")
    environment = os.environ | {"VASTFLOW_STORE": str(folder / "store")}
    done = subprocess.run(
        [sys.executable, str(example)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert PRINTS[example.stem] in done.stdout
