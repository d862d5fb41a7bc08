"""Test the wheel in empty environments: of each Python, or with each version of numba or Prefect that is allowed.

Builds the wheel, and for each environment installs it by uv. Of a Python, the quickstart is then written into an empty folder and run
twice: the second time nothing may be executed. Home, cache and store are new, so this is the first run of a new user. Then the tests of
`sim`, `producers` and `oracles` run against what is installed. Of numba each minor version runs the tests of kernels and golden runs, of
Prefect the oldest and the newest release those of the adapter: what vastflow uses beyond their documents is in
`sim/kernels/numba_target.py` and `tasks/prefect/adapter.py`. `--only` may name versions that are not allowed yet.

    python tests/proofs/installed.py [--python python3.12 --python python3.13 ...] [--runs N] [--tests PATH ...]
    python tests/proofs/installed.py numba|prefect [--only VERSION ...] [--tests PATH ...]

Prints CPU and wall seconds of each step beside those of an empty loop. Exit code 1 when a step fails.
"""

import argparse
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "studies"))
from bench_show import loop_s

ROOT = Path(__file__).parents[2]
CORES = ("tests/sim", "tests/producers", "tests/oracles")
SUITES = {
    "numba": ("tests/sim/test_sim_kernel_cache.py", "tests/sim/test_sim_golden_runs.py"),
    "prefect": tuple(f"tests/tasks/test_{name}.py" for name in ("prefect_adapter", "orphans", "campaign_log")),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("package", nargs="?", choices=SUITES, help="whose versions are tried; else Pythons are")
    parser.add_argument(
        "--python", action="append", help="interpreter, by name or path; may be repeated; else this one"
    )
    parser.add_argument("--only", nargs="+", metavar="VERSION", help="these versions of the package alone")
    parser.add_argument("--runs", type=int, help="runs per configuration of the quickstart, in place of the file's")
    parser.add_argument("--tests", nargs="*", help="tests to run; none for the campaign alone")
    asked = parser.parse_args()
    pythons = asked.python or [sys.executable]
    if missing := [program for program in (*pythons, "uv") if shutil.which(program) is None]:
        print(f"{', '.join(missing)}: no such program; expected one that is installed", file=sys.stderr)
        return 2
    tests = asked.tests if asked.tests is not None else SUITES.get(asked.package, CORES)
    with tempfile.TemporaryDirectory(prefix="vastflow-installed-") as temporary:
        source = Path(temporary, "source")
        wheel = built(source)
        if asked.package is None:
            return max(proved(python, wheel, source, tests, runs=asked.runs) for python in pythons)
        pins = [f"{asked.package}=={each}.*" for each in asked.only or ()] or allowed(asked.package)
        return max(proved(pythons[0], wheel, source, tests, pin=pin) for pin in pins)


def built(source: Path) -> Path:
    """The wheel of a copy of this checkout, whose tests stay as they were when it was built.

    Args:
        source: Folder for the copy, without what git ignores: a `build` folder could put yesterday's modules into the wheel.
    """
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(listing, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in listed.split("\0"):
        if name and ((ROOT / name).is_symlink() or (ROOT / name).exists()):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name, follow_symlinks=False)
    if uv := shutil.which("uv"):
        command = [uv, "build", "--quiet", "--wheel", "--out-dir", source.parent, source]
    else:
        command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", source.parent, source]
    subprocess.run(command, check=True)
    (wheel,) = source.parent.glob("*.whl")
    return wheel


def allowed(package: str) -> list[str]:
    """Pins of what pyproject.toml allows: each minor version of numba, the oldest and the newest release of Prefect."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (need,) = (each for each in map(Requirement, project["dependencies"]) if each.name == package)
    bounds = {each.operator: Version(each.version) for each in need.specifier}
    if package == "numba":
        return [f"numba==0.{minor}.*" for minor in range(bounds[">="].minor, bounds["<"].minor)]
    return [f"{package}=={bounds['>=']}", str(need)]


@dataclass
class Steps:
    """Commands in one environment, each with its cost on the terminal."""

    environment: dict[str, str]
    folder: Path
    failed: list[str] = field(default_factory=list)

    def run(self, what: str, *command: object, cwd: Path | None = None) -> str:
        """Return the output of a command; show its error output if it fails, and run nothing after it."""
        if self.failed:
            return ""
        before, began_s = cpu_s(), time.monotonic()
        words = [str(part) for part in command]
        done = subprocess.run(
            words, cwd=cwd or self.folder, env=self.environment, capture_output=True, text=True, check=False
        )
        print(f"  {what}: {cpu_s() - before:.1f} CPU-s, {time.monotonic() - began_s:.0f} s", flush=True)
        if done.returncode:
            self.failed.append(what)
            print(done.stdout[-4000:], done.stderr[-4000:], f"  {what}: exit code {done.returncode}", sep="\n")
        return done.stdout


def cpu_s() -> float:
    """CPU seconds of all processes that ended below this one."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def proved(
    python: str, wheel: Path, source: Path, tests: Sequence[str], *, pin: str = "", runs: int | None = None
) -> int:
    """The exit code of all steps in an environment of an interpreter, in which a version may be pinned."""
    ours = ("PYTHON", "VASTFLOW_", "PREFECT_")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    with tempfile.TemporaryDirectory(prefix="vastflow-first-") as temporary:
        home = Path(temporary)
        steps = Steps({**kept, "HOME": str(home), "XDG_CACHE_HOME": str(home / ".cache")}, home)
        programs = home / "env" / "bin"
        steps.run("environment", python, "-m", "venv", "--without-pip", home / "env")
        version = steps.run("version", programs / "python", "--version").strip()
        print(f"{version} {pin}, loop {loop_s():.3f} s", flush=True)
        (home / "pin.txt").write_text(pin)
        install = [shutil.which("uv"), "pip", "install", "-q", "--python", programs / "python"]
        install += ["--override", home / "pin.txt"]
        steps.run("install", *install, wheel)
        if not pin:
            quickstart(steps, programs / "vastflow", runs)
        if tests:
            steps.run("install of what tests need", *install, f"{wheel}[dev]")
            command = [programs / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
            said = steps.run("tests", *command, cwd=source)
            print("  " + (said.strip().splitlines() or ["no output"])[-1])
        if steps.failed:
            print(f"  failed: {', '.join(steps.failed)}")
        return 1 if steps.failed else 0


def quickstart(steps: Steps, vastflow: Path, runs: int | None) -> None:
    """The first campaign, and the same again, for which nothing may be left to do."""
    steps.run("vastflow --version", vastflow, "--version")
    campaign = re.search(r"^vastflow run (\S+)$", steps.run("vastflow init", vastflow, "init", "first"), re.MULTILINE)
    more = () if runs is None else ("--runs", runs)
    for which in ("first run", "again"):
        said = steps.run(which, vastflow, "run", campaign[1] if campaign else "", *more, "--json")
        if steps.failed:
            return
        summary = json.loads(said)
        print(f"    {summary['executed']} runs executed, {summary['reused']} from the store")
        if (summary["executed"] == 0) != (which == "again"):
            steps.failed.append(f"{which}: runs executed")


if __name__ == "__main__":
    sys.exit(main())
