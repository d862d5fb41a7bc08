"""The paper's three campaigns on the paper's maps, sampled to what some minutes of this machine's cores do.

    python docs/studies/paper_sample.py --maps ../shared/maps --minutes 10 --page docs/paper.md

For each campaign two small samples, in a store that is thrown away, measure what a configuration and what a call take of CPU time. Then
the campaign is **one** call on a store that is empty, as large a sample as the CPU time that is left allows: `cores × minutes` for all
three calls. So whatever the page says of CPU time and storage is of that call, and nothing of it was there before but compiled kernels.
Cores that are shared with others take longer, and measure about the same CPU time. With `--sample` the size is given, and there are no
small samples.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from missions import MAPS, map_files, parser_of
from paper_page import paper_page
from paper_results import paper_results

ROOT = Path(__file__).parents[2]
CAMPAIGNS = ROOT / "campaigns" / "paper" / "original-maps"
NAMES = ("performance", "robustness", "safety")
PILOTS = (5, 60)
"""Sizes of the small samples; the first call has to instantiate too, and perhaps to compile."""
SPARE = 0.95
"""Share of the CPU time that is planned: the cost of a configuration is estimated from a few."""


def main() -> None:
    """Run the samples, print what they took, and write the page."""
    parser = parser_of(__doc__)
    parser.add_argument("--maps", type=Path, default=MAPS, help="the paper's five maps")
    parser.add_argument(
        "--minutes", type=float, default=10.0, help="of each campaign with its small samples, all cores"
    )
    parser.add_argument("--sample", type=int, help="of each campaign, whatever time that takes; without small ones")
    parser.add_argument("--cores", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--runs", type=int, default=2, help="of each configuration")
    parser.add_argument("--only", choices=NAMES, action="append")
    parser.add_argument("--results", type=Path, default=ROOT / "results")
    parser.add_argument("--page", type=Path, help="where the page is written")
    asked = parser.parse_args()
    map_files(asked.maps, None)

    def run(name: str, sample: int, store: str) -> dict[str, Any]:
        """The summary of one call, with the CPU time of all its processes."""
        command = [sys.executable, "-m", "vastflow.flows.cli", "run", str(CAMPAIGNS / f"{name}.vast"), "--json"]
        given = {"map-dir": asked.maps, "runs": asked.runs, "results": asked.results, "workers": asked.cores}
        for option, value in {**given, "sample": sample, "store": store}.items():
            command += [f"--{option}", str(value)]
        before_s = sum(os.times()[2:4])
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        found = {**json.loads(done.stdout), "cpu_s": sum(os.times()[2:4]) - before_s}
        print(f"{name}: {found}", flush=True)
        return found

    def size(name: str) -> int:
        """Number of configurations for which the time is left."""
        with tempfile.TemporaryDirectory(prefix="paper-sample-") as store:
            first, second = (run(name, sample, store) for sample in PILOTS)
        of_one_s = second["cpu_s"] * asked.runs / max(second["executed"], 1)
        of_call_s = max(first["cpu_s"] - of_one_s * first["executed"] / asked.runs, 0.0)
        left_s = asked.minutes * 60 * asked.cores - first["cpu_s"] - second["cpu_s"]
        print(f"{name}: {of_one_s:.2f} CPU-s a configuration, {of_call_s:.0f} a call, {left_s:.0f} left", flush=True)
        return max(int((SPARE * left_s - of_call_s) / of_one_s), max(PILOTS))

    found = []
    for name in asked.only or NAMES:
        with tempfile.TemporaryDirectory(prefix="paper-sample-") as store:
            found.append(Path(run(name, asked.sample or size(name), store)["results"]))
    page = paper_page([paper_results(directory) for directory in found])
    if asked.page:
        asked.page.write_text(page, encoding="utf-8")
        print(f"written: {asked.page}")


if __name__ == "__main__":
    main()
