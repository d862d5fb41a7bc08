"""Test compilation and golden runs with each allowed minor version of numba.

What vastflow uses of numba beyond its documents is in `sim/kernels/numba_target.py`; CI runs its tests with one release. Exit code 1
when one fails.

    python tests/proofs/numba_versions.py [--folder FOLDER] [--only 0.62 0.65 ...]
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

from installed import built
from prefect_versions import pins, proved, resolved

TESTS = (
    "tests/sim/test_sim_kernel_cache.py",
    "tests/sim/test_sim_golden_runs.py",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="folder in which the environments are made and kept")
    parser.add_argument("--only", nargs="+", metavar="MINOR", help="these minor versions alone")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="numba-versions-") as temporary:
        folder, wheel = asked.folder or Path(temporary), built(Path(temporary, "source"))
        codes = [proved(folder / minor, wheel, resolved_pin(minor), TESTS) for minor in asked.only or minors()]
    return max(codes)


def minors() -> list[str]:
    """Minor versions that pyproject.toml allows."""
    oldest, allowed = pins("numba")
    newest = re.search(r"<0\.(\d+)", allowed)
    assert newest is not None, allowed
    return [f"0.{minor}" for minor in range(int(oldest.split(".")[1]), int(newest[1]))]


def resolved_pin(minor: str) -> str:
    return f"numba=={resolved(f'numba=={minor}.*')}"


if __name__ == "__main__":
    sys.exit(main())
