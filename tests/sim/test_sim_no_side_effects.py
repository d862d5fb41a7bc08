"""Importing and using the simulator changes nothing of a process that is its user's, and is not changed by it.

Each case is a process of its own: what is compiled depends on what was compiled before.
"""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

MEANWHILE = {
    "numba is set up": """
from numba.core import config
config.CPU_NAME, config.CPU_FEATURES, config.CACHE_DIR = "nehalem", "", "somewhere"
config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE = config._OptLevel(1), 0, 1
""",
    "a function is compiled": """
import numba
import numpy as np
numba.njit(lambda x: np.correlate(x, x).sum())(np.ones(3))
""",
    "kernels are compiled": """
import numpy as np
from vastflow.sim.kernels.numeric import njit
njit(lambda x: np.abs(x).sum())(np.ones(3))
""",
}
"""Actions of a process before it compiles the examined function."""

PROGRAM = """
import hashlib, json, re, sys

task = json.load(sys.stdin)
for each in task["before"]:
    exec(each)

import numba
import numpy as np

if task["kernel"]:
    from vastflow.sim.kernels.numeric import njit
else:
    from numba import njit

@njit
def looked_at(a, b):
    total = np.float32(0.0)
    for i in range(a.size):
        b[i] = b[i] * a[i] + a[i]
        total += abs(b[i])
    return total + np.sqrt(b).sum() + np.correlate(a, b)[0]

found = looked_at(np.linspace(0, 1, 37), np.linspace(1, 2, 37))
(assembly,) = looked_at.inspect_asm().values()
names = sorted(set(re.findall(r"[\\w.$]*_ZN\\w+", assembly)), key=len, reverse=True)
for name in names:  # they count what the process has compiled
    assembly = assembly.replace(name, "name")
assembly = "\\n".join(line for line in assembly.splitlines() if re.match("\\t[^.]", line))  # others tell lengths of names
print(found.hex(), hashlib.sha256(assembly.encode()).hexdigest())
"""


def run_python(program: str, given: str = "", folder: str | None = None) -> str:
    """Return the output of a program in its own process."""
    environment = {**os.environ, "PYTHONHASHSEED": "0", **({"XDG_CACHE_HOME": folder} if folder else {})}
    options = {"input": given, "env": environment, "cwd": folder, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "-c", program], check=False, timeout=240, **options)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.fixture
def compiled(tmp_path_factory):
    """Result and machine code of a kernel or a user's function, in a process that did something before."""

    def made(kernel: bool, *before: str) -> str:
        task = {"kernel": kernel, "before": [MEANWHILE[each] for each in before]}
        return run_python(PROGRAM, json.dumps(task), str(tmp_path_factory.mktemp("alone")))

    return made


def test_kernel_is_independent_of_user_numba_settings(compiled):
    assert compiled(True, "numba is set up", "a function is compiled") == compiled(True)


@pytest.mark.parametrize("before", [[], ["numba is set up"]])
def test_user_numba_functions_are_unaffected_by_kernels(compiled, before):
    assert compiled(False, *before, "kernels are compiled") == compiled(False, *before)


WATCH = """
import json, logging, signal, sys, warnings
import {before}

def seen():
    from numba.core import config
    return {{
        "numba": {{name: str(value) for name, value in vars(config).items() if name.isupper()}},
        "warnings": [str(each) for each in warnings.filters] + [str(warnings.showwarning)],
        "logging": [str(logging.root), str(logging.root.handlers), logging.raiseExceptions, str(logging.getLoggerClass())],
        "signals": [str(signal.getsignal(number)) for number in sorted(signal.valid_signals())],
        "paths": [sys.path, sys.meta_path, sys.path_hooks],
        "limits": [sys.getrecursionlimit(), sys.getswitchinterval(), sys.flags, str(sys.excepthook)],
        "random": [str(np.random.get_state()), str(random.getstate()), np.geterr()],
    }}

import random
import numpy as np
import numba
before = seen()
from {module} import {name}
{use}
after = seen()
print(json.dumps([key for key in before if str(before[key]) != str(after[key])]))
"""


@pytest.mark.parametrize(
    ("module", "name", "use", "before"),
    [
        ("vastflow.flows", "run_campaign", "", "numba"),
        ("vastflow.sim.run", "run", "", "scipy.ndimage, pymunk, shapely, py_trees"),
        ("vastflow.sim.kernels.numeric", "njit", "njit(lambda x: np.abs(x).sum())(np.ones(3))", "numba"),
    ],
)
def test_importing_and_compiling_leaves_the_process_as_it_was(module, name, use, before):
    # What libraries do when they are imported is theirs: they are imported before.
    assert run_python(WATCH.format(module=module, name=name, use=use, before=before)) == "[]\n"
