"""Digests of what a host computes: golden runs, and plan, recordings, traces, and verdicts of some runs of the quickstart.

    python tests/proofs/same_bits.py > here.txt

Two hosts of one architecture, with the libraries of `deployments/constraints.txt`, print the same. It was compared on one machine with
itself under NPY_DISABLE_CPU_FEATURES (all that NumPy dispatches by) and GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,…, with another
Debian's C library under bubblewrap, and with other versions of Python.
"""

import sys
from importlib import import_module
from pathlib import Path

from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import oracles_of
from vastflow.oracles.observation.observe import observe_block
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.digest import digest
from vastflow.sim.run import run
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, numeric_class
from vastflow.tasks.keys.source import installed_tree

ROOT = Path(__file__).parents[2]
ORACLES = ("success", "safety", "performance", "robustness", "navigation")
EVERY = 3
"""One configuration of so many is run."""


def golden() -> None:
    """Print the golden runs' digests, and whether they are those that are pinned."""
    sys.path += [str(ROOT / "tests" / name) for name in ("sim", "support")]
    runs = import_module("test_sim_golden_runs")
    for kind, pinned in runs.GOLDEN.items():
        found = runs.run_of(*kind).digest
        print(*kind, found[:20], "as pinned" if found.startswith(pinned.digest) else "OTHER", flush=True)


def quickstart() -> None:
    """Print digests of the plan, and of all that a run of each of some configurations leads to."""
    found = instantiate(load_campaign(ROOT / "campaigns" / "quickstart" / "quickstart.vast")).configurations
    print("plan", len(found), digest([each.scenario.digest for each in found]))
    oracles = oracles_of([(name, {}) for name in ORACLES])
    for each in found[::EVERY]:
        recording = run(each.scenario, 0, 7)
        block = write_recordings([recording])
        trace = observe_block(each.scenario, block)
        verdicts = judge_block(each.scenario, block, trace, oracles).verdicts
        print(each.name, recording.digest[:20], digest(trace.hex())[:20], digest(repr(verdicts))[:20], flush=True)


if __name__ == "__main__":
    tree = installed_tree()
    print(numeric_class(), *(tree.digest(*each)[:20] for each in (EXECUTE_SOURCE, OBSERVE_SOURCE, JUDGE_SOURCE)))
    golden()
    quickstart()
