"""Test the wheel in an empty environment of each Python.

Builds the wheel, and for each interpreter makes an environment, installs the wheel by uv where there is one and else by pip, writes the
quickstart into an empty folder and runs it twice: the second time nothing may be executed. Home, cache and store are new, so this is
the first run of a new user. Then the tests of `sim`, `producers` and `oracles` run against what is installed. Prints CPU and wall
seconds of each step beside those of an empty loop. Exit code 1 when a step fails.

    python tests/proofs/installed.py [--python python3.12 --python python3.13 ...] [--runs N] [--tests PATH ...]
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
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORES = ("tests/sim", "tests/producers", "tests/oracles")
LOOPS = 5_000_000


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--python", action="append", help="An interpreter, by name or path; may be repeated. Else this one."
    )
    parser.add_argument("--runs", type=int, help="Runs per configuration of the quickstart, in place of the file's.")
    parser.add_argument("--tests", nargs="*", default=CORES, help="Tests to run; none for the campaign alone.")
    asked = parser.parse_args()
    pythons = asked.python or [sys.executable]
    if missing := [python for python in pythons if shutil.which(python) is None]:
        print(f"--python {', '.join(missing)}: no such program; name interpreters that are installed", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="vastflow-installed-") as temporary:
        source = Path(temporary, "source")
        wheel = built(source)
        tests = [source / test for test in asked.tests]
        return max(proved(python, wheel, asked.runs, tests) for python in pythons)


def built(source: Path) -> Path:
    """The wheel of a copy of this checkout, whose tests stay as they were when it was built.

    Args:
        source: Where the copy is made: less what git ignores, for a `build` folder could put yesterday's modules into the wheel.
    """
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
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


@dataclass
class Steps:
    """Commands in one environment, each with its cost on the terminal."""

    environment: dict[str, str]
    folder: Path
    failed: list[str] = field(default_factory=list)

    def run(self, what: str, *command: object) -> str:
        """Return the output of a command; show its error output if it fails."""
        before, began_s = cpu_s(), time.monotonic()
        done = subprocess.run(
            [str(part) for part in command],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
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


def loop_s() -> float:
    """CPU seconds of the loop that figures are compared by."""
    began_s = time.process_time()
    for _ in range(LOOPS):
        pass
    return time.process_time() - began_s


def proved(python: str, wheel: Path, runs: int | None, tests: list[Path]) -> int:
    """The exit code of all steps with an interpreter."""
    with tempfile.TemporaryDirectory(prefix="vastflow-first-") as temporary:
        home = Path(temporary)
        kept = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("PYTHON", "VASTFLOW_", "PREFECT_"))
        }
        steps = Steps({**kept, "HOME": str(home), "XDG_CACHE_HOME": str(home / ".cache")}, home)
        bin_ = home / "env" / "bin"
        uv = shutil.which("uv")
        steps.run("environment", python, "-m", "venv", *(["--without-pip"] if uv else []), home / "env")
        install = [uv, "pip", "install", "--python", bin_ / "python"] if uv else [bin_ / "pip", "install"]
        print(f"{steps.run('version', bin_ / 'python', '--version').strip()}, loop {loop_s():.3f} s", flush=True)
        steps.run(f"install by {'uv' if uv else 'pip'}", *install, "-q", wheel)
        if not steps.failed:
            quickstart(steps, bin_ / "vastflow", runs)
        if not steps.failed and tests:
            wanted = ("pytest", "hypothesis")
            dev = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
                "optional-dependencies"
            ]["dev"]
            steps.run("install of what tests need", *install, "-q", *(need for need in dev if need.startswith(wanted)))
            said = steps.run(
                "tests of the cores", bin_ / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests
            )
            print("  " + (said.strip().splitlines() or ["no output"])[-1])
        if steps.failed:
            print(f"  failed: {', '.join(steps.failed)}")
        return 1 if steps.failed else 0


def quickstart(steps: Steps, vastflow: Path, runs: int | None) -> None:
    """The first campaign, and the same again, for which nothing may be left to do."""
    steps.run("vastflow --version", vastflow, "--version")
    said = steps.run("vastflow init", vastflow, "init", "first")
    campaign = re.search(r"^vastflow run (\S+)$", said, re.MULTILINE)
    if campaign is None:
        steps.failed.append("vastflow init")
        return
    more = () if runs is None else ("--runs", runs)
    for which in ("first run", "again"):
        said = steps.run(which, vastflow, "run", campaign[1], *more, "--json")
        if steps.failed:
            return
        summary = json.loads(said)
        print(f"    {summary['executed']} runs executed, {summary['reused']} from the store")
        if (summary["executed"] == 0) != (which == "again"):
            steps.failed.append(f"{which}: runs executed")


if __name__ == "__main__":
    sys.exit(main())
