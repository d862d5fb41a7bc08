"""Check that a defect of the machine is reported in one sentence, and that the same command resumes afterwards.

A campaign without a robot is run once undisturbed. Then, for each condition, it is run on a machine that is spoiled in a mount
namespace of its own, or as another user, with an empty store:

- the exit code is 2, what is said ends with one sentence of the condition, and there is no traceback;
- no half campaign directory is taken for a whole one;
- the same command on the mended machine ends with 0, and its verdicts are those of the undisturbed campaign.

Needs root, `unshare` and `setpriv`. Prints a line for each condition; exit code 1 when something is violated.

    python tests/proofs/environment.py [--condition NAME ...] [--early]
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import platformdirs
import pyarrow.parquet as pq

ROOT: Final = Path(__file__).parents[2]
VASTFLOW: Final = (sys.executable, "-m", "vastflow.flows.cli")
TIMEOUT_S: Final = 900.0

JUMPS: Final = """
import random, time
real, begun = time.time, time.monotonic()
time.time = lambda: real() + random.Random(int((time.monotonic() - begun) / 2)).choice((0, 86400, -86400, 3600, -3600))
"""
"""For `sitecustomize`: a clock that jumps by hours and days every two seconds, in every process."""


@dataclass(frozen=True)
class Condition:
    """A defect of the machine.

    Attributes:
        spoil: Shell commands before vastflow's, in a mount namespace of its own; LAB is the folder of the condition.
        says: Pattern of the sentence; empty where the campaign must succeed all the same.
        results: Folder for the campaign directory, below LAB.
        user: Runs vastflow.
        early: Whether it is found before anything is started.
        environment: More variables.
    """

    name: str
    spoil: str
    says: str
    results: str = "results"
    user: int = 0
    early: bool = False
    environment: tuple[tuple[str, str], ...] = ()


def _full(place: str, size: str = "64k") -> str:
    """A file system at a place of LAB that has room for next to nothing."""
    return f"mkdir -p {place} && mount -t tmpfs -o size={size} none {place}"


CONDITIONS: Final = (
    Condition("read-only home", "mount -t tmpfs -o ro none LAB/home", r"can't (write to|be written below) '.*' \(Read-only file system\); set XDG_\w+", early=True,
              environment=(("HOME", "LAB/home"), ("XDG_CACHE_HOME", ""))),
    Condition("read-only Prefect home", "mount -t tmpfs -o ro none LAB/prefect", r"can't write to '.*prefect' \(Read-only .*\); set PREFECT_HOME",
              early=True, environment=(("PREFECT_HOME", "LAB/prefect"),)),
    Condition("no /dev/shm", "mount -t tmpfs -o ro none /dev/shm", r"can't write to '/dev/shm' \(Read-only file system\); mount a tmpfs there", early=True),
    Condition("read-only store", "mkdir -p LAB/store && mount -t tmpfs -o ro none LAB/store", r"store: can't write to '.*store' \(Read-only file system\)", early=True),
    Condition("full store", _full("LAB/store"), r"store: .*No space left on device.*make room"),
    Condition("full temporary folder", _full("LAB/tmp", "8k"), r"can't write to '.*tmp' \(No space left on device\); set TMPDIR to a folder of yours, or make room",
              environment=(("TMPDIR", "LAB/tmp"),)),
    Condition("read-only results", "mkdir -p LAB/results && mount -t tmpfs -o ro none LAB/results", r"results: .*Read-only file system|--results .*no permission"),
    Condition("full results", _full("LAB/results"), r"results: can't write to '.*results' \(No space left on device\); make room"),
    Condition("another user's store", "mkdir -p LAB/store && chmod 755 LAB/store && chmod 777 LAB", r"store: can't write to '.*store' \(Permission denied\)", user=65534, early=True,
              environment=(("XDG_CACHE_HOME", "LAB/cache"),)),
    Condition("another user's home", "chmod 777 LAB", r"can't (write to|be written below) '.*' \(Permission denied\); set XDG_", user=65534, early=True,
              environment=(("HOME", "LAB/home"), ("XDG_CACHE_HOME", ""))),
    Condition("results name too long", "true", r"--results .*File name too long; expected a folder", results="a" * 300, early=True),
    Condition("results at a dangling link", "ln -s nowhere LAB/link", r"--results .*link is a broken link", results="link", early=True),
    Condition("a clock that jumps", "true", "", environment=(("PYTHONPATH", "LAB/jumps"),)),
)  # fmt: skip


@dataclass(frozen=True)
class Lab:
    """A folder with a campaign of two configurations, and one for each condition."""

    folder: Path

    def laid_out(self) -> None:
        """Write the campaign."""
        shutil.copytree(
            ROOT / "campaigns" / "growth", self.folder / "growth", ignore=shutil.ignore_patterns("__pycache__")
        )
        file = self.folder / "growth" / "growth.vast"
        text = file.read_text().replace("[0.5, 1.0, 2.0, 3.0, 4.0]", "[0.5, 3.0]").replace("[1, 10, 100, 900]", "[10]")
        file.write_text(text)
        for path in (self.folder, *self.folder.rglob("*")):
            path.chmod(0o755)

    def run(self, condition: Condition, *, spoiled: bool) -> "subprocess.CompletedProcess[str]":
        """Run the campaign under a condition, or on the mended machine with the same store."""
        lab = self.folder / condition.name.replace(" ", "-").replace("/", "").replace("'", "")
        for name in ("home", "prefect", "jumps"):
            (lab / name).mkdir(parents=True, exist_ok=True)
        (lab / "jumps" / "sitecustomize.py").write_text(JUMPS)
        results = condition.results if spoiled else "results"
        command = [*VASTFLOW, "run", str(self.folder / "growth" / "growth.vast"), "--workers", "1",
                   "--store", str(lab / "store"), "--results", str(lab / results)]  # fmt: skip
        if spoiled:
            user = ["setpriv", "--reuid", str(condition.user), "--regid", str(condition.user), "--clear-groups"]
            spoil = f'{condition.spoil} && exec "$@"'.replace("LAB", str(lab))
            command = ["unshare", "-m", "sh", "-ec", spoil, "sh", *(user if condition.user else []), *command]
        given = {name: value.replace("LAB", str(lab)) for name, value in condition.environment} if spoiled else {}
        environment = {name: value for name, value in {**os.environ, **given}.items() if value}
        return subprocess.run(
            command, env=environment, cwd=lab, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )

    def verdicts(self, condition: Condition) -> list[bytes]:
        """Verdicts of every campaign directory of a condition; not their metrics, for a program's time is never the same."""
        lab = self.folder / condition.name.replace(" ", "-").replace("/", "").replace("'", "")
        files = sorted(lab.glob("results/[!.]*/verdicts.parquet"))
        rows = (pq.read_table(file, columns=["configuration", "run_index", "oracle", "judgement"]) for file in files)
        return [repr(sorted(map(repr, table.to_pylist()))).encode() for table in rows]


def refused(condition: Condition, lab: Lab) -> str | None:
    """Return the fault in the report of a defect, or None."""
    found = lab.run(condition, spoiled=True)
    said = [line for line in found.stderr.splitlines() if line and not re.match(r"\[ *\d|\s|.*Warning:", line)]
    if "Traceback" in found.stderr:
        return f"a traceback: {found.stderr[-600:]}"
    if not condition.says:
        return None if found.returncode == 0 else f"exit code {found.returncode}: {found.stderr[-600:]}"
    if found.returncode != 2:
        return f"exit code {found.returncode}: {found.stderr[-600:]}"
    if not said or not re.search(condition.says, said[-1]) or len(said) > 1:
        return f"it says {said}"
    if lab.verdicts(condition):
        return "it left a campaign directory"
    return None


def mended(condition: Condition, lab: Lab, whole: list[bytes]) -> str | None:
    """Return the fault in how the same command resumes, or None."""
    found = lab.run(condition, spoiled=False)
    if found.returncode or "Traceback" in found.stderr:
        return f"afterwards exit code {found.returncode}: {found.stderr[-600:]}"
    verdicts = lab.verdicts(condition)
    return None if verdicts and all(each == whole[0] for each in verdicts) else "afterwards other verdicts"


def main() -> int:
    """Try the conditions, and print what came of each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--condition", action="append", default=[], choices=[each.name for each in CONDITIONS])
    parser.add_argument(
        "--early", action="store_true", help="only what is found before anything is started, and without going on"
    )
    asked = parser.parse_args()
    # Kernels and Prefect's database are not what is tried here: they are those of this user, as are their folders.
    os.environ.setdefault("XDG_CACHE_HOME", str(Path(platformdirs.user_cache_dir("vastflow")).parent))
    n_violations = 0
    with tempfile.TemporaryDirectory(prefix="vastflow-environment-") as name:
        lab = Lab(Path(name))
        lab.laid_out()
        whole: list[bytes] = []
        if not asked.early:
            undisturbed = Condition("undisturbed", "true", "")
            found = lab.run(undisturbed, spoiled=False)
            whole = lab.verdicts(undisturbed)
            print(f"{'undisturbed':28} exit code {found.returncode}", flush=True)
        for condition in CONDITIONS:
            if (asked.condition and condition.name not in asked.condition) or (asked.early and not condition.early):
                continue
            begun_s = time.monotonic()
            wrong = refused(condition, lab) or (None if asked.early else mended(condition, lab, whole))
            n_violations += wrong is not None
            print(f"{condition.name:28} {wrong or 'as it should be'} ({time.monotonic() - begun_s:.0f} s)", flush=True)
    return int(n_violations > 0)


if __name__ == "__main__":
    sys.exit(main())
