"""The oldest and the newest Prefect allowed, each in an environment of its own, with the tests of the adapter.

What vastflow uses of Prefect beyond its documents is in `tasks/prefect_adapter.py`; CI runs its tests with one release. This command
reads from `pyproject.toml` which releases are allowed, installs vastflow beside each of the two by pip, and runs the tests there.
Exit code 1 when one fails.

    python tests/proofs/prefect_versions.py [--folder FOLDER] [--tests PATH ...]
"""

import argparse
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ("tests/tasks/test_prefect_adapter.py", "tests/tasks/test_ledger.py", "tests/tasks/test_campaign_log.py")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="Where the environments are made, and kept; else a temporary one.")
    parser.add_argument("--tests", nargs="+", default=TESTS)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="prefect-versions-") as temporary:
        folder = asked.folder or Path(temporary)
        return max(proved(folder / name, pin, asked.tests) for name, pin in pins().items())


def pins() -> dict[str, str]:
    """What pip is asked for: the oldest release allowed, and the newest that resolves."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (allowed,) = (each for each in project["dependencies"] if each.startswith("prefect"))
    oldest = re.search(r">=([\d.]+)", allowed)
    assert oldest is not None, allowed
    return {"oldest": f"prefect=={oldest[1]}", "newest": allowed}


def proved(environment: Path, pin: str, tests: tuple[str, ...] | list[str]) -> int:
    """The exit code of the tests in an environment with this Prefect."""
    if not (environment / "bin" / "python").exists():
        venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    quiet = ("-q", "--disable-pip-version-check")
    subprocess.run([python, "-m", "pip", "install", *quiet, "--upgrade", pin, f"{ROOT}[dev]"], check=True)
    version = subprocess.run(
        [python, "-c", "import importlib.metadata as m; print(m.version('prefect'))"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    print(f"{environment.name}: prefect {version}", flush=True)
    done = subprocess.run([python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests], cwd=ROOT, check=False)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
