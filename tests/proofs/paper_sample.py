"""The paper's three campaigns on the paper's maps, sampled to what some minutes of this machine's cores do.

    python tests/proofs/paper_sample.py --maps ../shared/maps --minutes 10 --page docs/paper.md

For each campaign three small samples, in a store that is thrown away, measure what a configuration and what a call take of
CPU time, by what the processes of the call used (`getrusage` of children). Then the campaign is **one** call on a store that is
empty, as large a sample as the CPU time that is left allows: `cores × minutes` for all three calls. So whatever the page says
of CPU time and storage is of that call, and nothing of it was there before but compiled kernels. Cores that are shared with
others take longer, and measure about the same CPU time. With `--sample` the size is given, and there are no small samples.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
CAMPAIGNS = ROOT / "campaigns" / "paper" / "original-maps"
NAMES = ("performance", "robustness", "safety")
PILOTS = (1, 4, 12)
"""Sizes of the small samples, in `--pilot`s."""
SPARE = 0.95
"""Of the CPU time, what is planned: what a configuration costs is known from a few."""


@dataclass(frozen=True)
class Call:
    """One call of `vastflow run`: its summary, CPU and wall time (s)."""

    summary: dict[str, Any]
    cpu_s: float
    wall_s: float


def main() -> None:
    """Run the samples, print what they took, and write the page."""
    asked = _arguments()
    found = []
    for name in asked.only or NAMES:
        found.append(_sampled(name, asked))
    page = _vastflow(["dev", "paper", *found])
    if asked.page:
        asked.page.write_text(page.stdout, encoding="utf-8")
        print(f"written: {asked.page}")


def _sampled(name: str, asked: argparse.Namespace) -> str:
    """Run a sample of the requested size, or of the size that the time allows."""
    with tempfile.TemporaryDirectory(prefix="paper-sample-") as folder:
        if asked.sample:
            return str(_run(name, asked.sample, asked, Path(folder)).summary["results"])
        pilots = [_run(name, factor * asked.pilot, asked, Path(folder) / "pilots") for factor in PILOTS]
        left_s = asked.minutes * 60 * asked.cores - sum(call.cpu_s for call in pilots)
        of_one_s, of_call_s = _costs(pilots, asked.runs)
        size = max(int((SPARE * left_s - of_call_s) / of_one_s), PILOTS[-1] * asked.pilot)
        print(
            f"{name}: {of_one_s:.2f} CPU s a configuration and {of_call_s:.0f} CPU s a call, {left_s:.0f} CPU s left: "
            f"a sample of {size}",
            flush=True,
        )
        return str(_run(name, size, asked, Path(folder) / "whole").summary["results"])


def _costs(pilots: list[Call], runs: int) -> tuple[float, float]:
    """CPU time of a configuration and of a call on an empty store (s).

    Of a configuration by the two last calls, which executed different numbers of them; of a call by the first, which had
    to instantiate too, and perhaps to compile.
    """
    first, few, many = pilots
    of_one_s = (many.cpu_s - few.cpu_s) * runs / max(many.summary["executed"] - few.summary["executed"], 1)
    # On a busy machine the difference of two calls may be anything.
    of_one_s = max(of_one_s, 0.3 * many.cpu_s * runs / max(many.summary["executed"], 1))
    return of_one_s, max(first.cpu_s - of_one_s * first.summary["executed"] / runs, 0.0)


def _run(name: str, sample: int, asked: argparse.Namespace, store: Path) -> Call:
    before, began = _children_s(), time.perf_counter()
    options = {
        "map-dir": asked.maps,
        "runs": asked.runs,
        "sample": sample,
        "results": asked.results,
        "workers": asked.cores,
        "store": store,
    }
    words = [word for key, value in options.items() for word in (f"--{key}", str(value))]
    done = _vastflow(["run", str(CAMPAIGNS / f"{name}.vast"), *words, "--json"])
    call = Call(json.loads(done.stdout), _children_s() - before, time.perf_counter() - began)
    summary = call.summary
    print(
        f"{name}: {summary['configurations']} of {summary['sampled_from']} configurations × {asked.runs}: "
        f"{summary['executed']} runs executed, {summary['simulated_s'] / 3600:.2f} simulated h, {call.cpu_s:.0f} CPU s "
        f"({summary['cpu_s']:.0f} by its own account), {call.wall_s:.0f} s; "
        f"{summary['passed']} passed, {summary['failed']} failed",
        flush=True,
    )
    return call


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _vastflow(words: list[str]) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-m", "vastflow.flows.cli", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"vastflow {' '.join(words)} ended with {done.returncode}:\n{done.stderr[-2000:]}")
    return done


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", type=Path, default=ROOT.parent / "shared" / "maps", help="the paper's five maps")
    parser.add_argument(
        "--minutes", type=float, default=10.0, help="of each campaign with its small samples, all cores"
    )
    parser.add_argument("--sample", type=int, help="of each campaign, whatever time that takes; without small ones")
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--runs", type=int, default=2, help="of each configuration")
    parser.add_argument("--pilot", type=int, default=5, help="configurations of the first sample")
    parser.add_argument("--only", choices=NAMES, action="append")
    parser.add_argument("--results", type=Path, default=ROOT / "results")
    parser.add_argument("--page", type=Path, help="where the page is written")
    return parser.parse_args()


if __name__ == "__main__":
    main()
