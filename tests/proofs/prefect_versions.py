"""The oldest and the newest Prefect allowed, each in an environment of its own, with the tests of the adapter.

What vastflow uses of Prefect beyond its documents is in `tasks/prefect/adapter.py`; CI runs its tests with one release. This command
reads from `pyproject.toml` which releases are allowed, installs vastflow beside each of the two by pip, and runs the tests there.
Where one release is both, its tests run once. `--beyond 3.9.1` tries a release that is not allowed yet, with what it requires as
far as there is such a release. Exit code 1 when one fails.

    python tests/proofs/prefect_versions.py [--folder FOLDER] [--beyond RELEASE] [--tests PATH ...]
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path

from installed import built

ROOT = Path(__file__).parents[2]
QUIET = ("-q", "--disable-pip-version-check")
REQUIRED = "import importlib.metadata as m; print(*(r for r in m.requires('prefect') if 'extra' not in r), sep='\\n')"
TESTS = ("tests/tasks/test_prefect_adapter.py", "tests/tasks/test_orphans.py", "tests/tasks/test_campaign_log.py")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="Where the environments are made, and kept; else a temporary one.")
    parser.add_argument("--tests", nargs="+", default=TESTS)
    parser.add_argument("--beyond", metavar="RELEASE", help="Try this release too, whatever it requires.")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="prefect-versions-") as temporary:
        folder, wheel = asked.folder or Path(temporary), built(Path(temporary, "source"))
        releases = dict.fromkeys(map(resolved, pins("prefect")))
        codes = [proved(folder / release, wheel, f"prefect=={release}", asked.tests) for release in releases]
        if asked.beyond:
            codes.append(proved(folder / asked.beyond, wheel, f"prefect=={asked.beyond}", asked.tests, beyond=True))
        return max(codes)


def pins(package: str) -> tuple[str, str]:
    """Pins of the oldest release that pyproject.toml allows, and of any that it allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (allowed,) = (each for each in project["dependencies"] if re.match(rf"{package}\b", each))
    oldest = re.search(r">=([\d.]+)", allowed)
    assert oldest is not None, allowed
    return f"{package}=={oldest[1]}", allowed


def resolved(pin: str) -> str:
    """The release that pip takes for a pin."""
    asked = ("install", *QUIET, "--dry-run", "--no-deps", "--ignore-installed", "--report", "-", pin)
    said = subprocess.run([sys.executable, "-m", "pip", *asked], capture_output=True, text=True, check=True).stdout
    (found,) = json.loads(said)["install"]
    return str(found["metadata"]["version"])


def proved(environment: Path, wheel: Path, pin: str, tests: Sequence[str], *, beyond: bool = False) -> int:
    """Return the exit code of the tests in an environment with the release that is pinned.

    Args:
        wheel: Of this checkout: in the checkout itself pip would build it, and leave its folder there.
        beyond: The release is installed over one that is allowed.
    """
    if not (environment / "bin" / "python").exists():
        venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    pip = [python, "-m", "pip", "install", *QUIET]
    subprocess.run([*pip, *([] if beyond else [pin]), f"{wheel}[dev]"], check=True)
    subprocess.run([*pip, "--no-deps", "--force-reinstall", wheel], check=True)  # one of this version may be there
    if beyond:
        subprocess.run([*pip, "--no-deps", pin], check=True)
        said = subprocess.run([python, "-c", REQUIRED], capture_output=True, text=True, check=True).stdout
        for required in said.splitlines():  # each by itself: what no index has is left as it is
            subprocess.run([*pip, required], check=False)
    print(pin, flush=True)
    done = subprocess.run([python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests], cwd=ROOT, check=False)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
