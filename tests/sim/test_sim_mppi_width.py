"""MPPI gives the same bits whatever the width of the processor's registers.

The width is fixed when kernels are imported, so the module is also the program that other processes run.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
from alone import Alone
from llvmlite import binding

from vastflow.sim.kernels.numba_target import AVX512, widest
from vastflow.sim.nav2.parameters.mppi import MppiParameters

FAR, NEAR, THERE = (5.0, 0.0, 0.0), (1.2, 0.1, 1.0), (0.4, 0.0, 1.0)


def commands() -> list[str]:
    """Commands and costs, bit for bit, on the way along a wall to a goal."""
    costs = np.zeros((60, 60), dtype=np.uint8)
    costs[36:] = np.linspace(20, 250, 24).astype(np.uint8)[:, None]
    costs[40:, 44:] = 254
    plan = np.column_stack([np.arange(56) * 0.025, 0.002 * np.arange(56)])
    lines = []
    for parameters in (MppiParameters(), MppiParameters(batch_size=1003, ax_min=-1.0)):
        controller = Alone(parameters, seed=99)
        for k, goal in enumerate((FAR, FAR, FAR, NEAR, THERE)):
            pose, twist = (0.01 * k, 0.02, 0.1 - 0.5 * k), (0.1 * k - 0.1, 0.1)
            valid, v, w, _ = controller.command(plan, costs, pose, twist, goal)
            assert valid
            judged = np.asarray(controller.memory.space.costs)[: parameters.batch_size]
            lines.append(f"{float(v).hex()} {float(w).hex()} {judged.tobytes().hex()}")
    return lines


def commands_with(features: str) -> list[str]:
    """The commands from a process whose kernels are compiled for these features."""
    environment = {**os.environ, "NUMBA_CPU_FEATURES": features, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, __file__]
    done = subprocess.run(command, check=False, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture(scope="module")
def narrow():
    found = commands_with("")
    assert len(found) == 30
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("needed", "features"), [("avx2", "+avx2"), ("avx512f", AVX512)], ids=["AVX2", "AVX-512"])
def test_wide_and_narrow_registers_give_the_same_commands_and_costs(narrow, needed, features):
    if not binding.get_host_cpu_features().get(needed):
        pytest.skip(f"the processor has no {needed}")
    wide = commands_with(features)
    assert [line[:60] for line in narrow] == [line[:60] for line in wide]
    assert narrow == wide


@pytest.mark.parametrize(
    ("processor", "features"),
    [
        ("Westmere", ""),
        ("avx2 Haswell", "+avx2"),
        ("avx2 avx512f avx512bw avx512dq avx512vl Skylake", "+avx2"),
        ("avx2 avx512f avx512bw avx512dq avx512vl avx512vbmi2 IceLake", "+avx2"),
        ("avx2 avx512f avx512bw avx512dq avx512vl avx512vbmi2 avx512bf16 SapphireRapids", AVX512),
    ],
)
def test_widest_registers_are_used_that_slow_no_processor_down(processor, features):
    assert widest(dict.fromkeys(processor.split(), True)) == features


if __name__ == "__main__":
    print(*commands(), sep="\n")
