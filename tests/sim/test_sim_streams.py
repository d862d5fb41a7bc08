"""Random streams and the cache of compiled kernels."""

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels import numeric
from vastflow.sim.kernels.streams import (
    AMCL,
    LIDAR,
    SUBSYSTEMS,
    normal_pair,
    run_entropy,
    streams_of,
    uniform,
)

DIGEST = "00ff" * 16


def test_streams_of_a_run_are_pinned():
    assert [hex(state) for state in streams_of(run_entropy(0, DIGEST, 0))[:, 0].tolist()] == [
        "0x6eb0dec9e8a52720",
        "0xe78f09fd730e95a0",
        "0xe30f00bcc8520b3e",
        "0xd3e2e01f84ff0fd4",
        "0x49c9ce63094355bf",
        "0x9a610b1b9dbc1151",
    ]


@each_row("other", [(1, DIGEST, 0), (0, "ff00" * 16, 0), (0, DIGEST, 1)])
def test_another_seed_situation_or_run_has_other_streams(other):
    assert (streams_of(run_entropy(*other)) != streams_of(run_entropy(0, DIGEST, 0))).all()


def test_subsystems_have_streams_of_their_own():
    states = streams_of(run_entropy(0, DIGEST, 0))
    assert states.shape == (SUBSYSTEMS, 1)
    assert len(np.unique(states)) == SUBSYSTEMS
    before = states[AMCL].copy()
    normal_pair(states[LIDAR])
    assert states[AMCL] == before


def test_uniform_numbers_fill_the_unit_interval_evenly():
    stream = streams_of([1])[0]
    numbers = np.array([uniform(stream) for _ in range(20_000)])
    assert (numbers >= 0).all() and (numbers < 1).all()
    counts = np.histogram(numbers, 20, (0, 1))[0]
    chi_square = ((counts - 1000) ** 2 / 1000).sum()
    assert chi_square < 19 + 5 * math.sqrt(2 * 19)


def test_normal_pairs_are_standard_normal_and_independent():
    stream = streams_of([2])[0]
    pairs = np.array([normal_pair(stream) for _ in range(20_000)])
    n = len(pairs)
    assert np.abs(pairs.mean(axis=0)).max() < 5 / math.sqrt(n)
    assert np.abs(pairs.std(axis=0) - 1).max() < 5 / math.sqrt(2 * n)
    assert abs((pairs[:, 0] * pairs[:, 1]).mean()) < 5 / math.sqrt(n)


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the simulator's source that the cache folder is computed from."""
    source = Path(numeric.__file__).parents[1]
    shutil.copytree(source, tmp_path / "sim", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(numeric, "__file__", str(tmp_path / "sim" / "kernels" / "numeric.py"))
    return tmp_path / "sim"


def test_equal_source_has_one_folder_of_compiled_kernels_wherever_it_lies(copied, monkeypatch):
    there = numeric.kernel_cache_dir()
    monkeypatch.undo()
    assert numeric.kernel_cache_dir() == there


@pytest.mark.parametrize("module", ["world/lidar.py", "nav2/planners/navfn.py"])
def test_edited_module_has_another_folder_of_compiled_kernels(copied, module):
    before = numeric.kernel_cache_dir()
    (copied / module).write_text((copied / module).read_text() + "\nX = 1\n")
    assert numeric.kernel_cache_dir() != before


@pytest.mark.parametrize("module", ["world/motion.py", "nav2/parameters/mppi.py"])
def test_digest_counts_constants_and_types_of_kernels(copied, module):
    before = numeric.kernel_cache_dir()
    (copied / module).write_text((copied / module).read_text() + "\nX = 1\n")
    assert numeric.kernel_cache_dir() != before


def test_edit_that_no_compiled_code_can_follow_from_compiles_nothing_again(copied):
    before = numeric.kernel_cache_dir()
    (copied / "run.py").write_text((copied / "run.py").read_text() + "\nX = 1\n")
    (copied / "nav2" / "new.py").write_text("")
    assert numeric.kernel_cache_dir() == before


def test_new_module_with_kernels_has_another_folder_of_compiled_kernels(copied):
    before = numeric.kernel_cache_dir()
    (copied / "nav2" / "new.py").write_text("from vastflow.sim.kernels.numeric import inner\n")
    assert numeric.kernel_cache_dir() != before


def test_another_numba_has_another_folder_of_compiled_kernels(monkeypatch):
    before = numeric.kernel_cache_dir()
    monkeypatch.setattr(numeric.numba, "__version__", "0.0.0")
    assert numeric.kernel_cache_dir() != before


@pytest.mark.slow
def test_kernels_without_checks_are_not_taken_where_indices_are_checked(tmp_path):
    file = tmp_path / "beyond.py"
    file.write_text(
        "import numpy as np\nfrom vastflow.sim.kernels.numeric import njit\n\n"
        "@njit\ndef read(values, index):\n    return values[index]\n\nread(np.zeros(3), 3)\n"
    )
    said = []
    for checked in ("0", "1", "0"):
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_BOUNDSCHECK": checked}
        ended = subprocess.run(
            [sys.executable, file], check=False, env=environment, capture_output=True, text=True, timeout=120
        )
        said.append(ended.stderr.splitlines()[-1:])
    assert said == [[], ["IndexError: index is out of bounds"], []]
