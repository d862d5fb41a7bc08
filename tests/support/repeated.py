"""Runs of the built-in robot as `replaying_bridge.py` repeats them."""

import hashlib
from pathlib import Path

from vastflow.sim.nav2.navigator.state import SUCCEEDED
from vastflow.sim.run import run

BRIDGE = str(Path(__file__).with_name("replaying_bridge.py"))


def repeated(scenario, run_index, seed):
    """Return the digest of a run's first scan, its commands with the tick of its success, and its recording."""
    scans, commands, ends = [], [], []

    def watch(stack, tick):
        m = stack.m[0]
        if tick == 0:
            scans.append(hashlib.sha256(m["ranges"][: int(m["beams"])].astype("<f4").tobytes()).hexdigest())
        commands.append([float(m[name]) for name in ("sent_v", "sent_vy", "sent_w")])
        if m["status"] == SUCCEEDED:
            ends.append(tick)

    recording = run(scenario, run_index, seed, watch, range(round(scenario.timeout_s * 20)))
    return scans[0], {"commands": commands, "ended": ends[0] + 1 if ends else None}, recording
