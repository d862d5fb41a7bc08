import platform
from dataclasses import replace

from table import each_row

from vastflow.tasks.keys.keys import Keys, numeric_class

KEYS = Keys(
    numeric="x86_64; glibc 2.36; avx2 fma; ",
    execute_source="e" * 64,
    observe_source="o" * 64,
    judge_source="j" * 64,
    seed=0,
    oracles=[("success", "s" * 64), ("performance", "p" * 64)],
)
SCENARIO, RECORDING, TRACE = "1" * 64, "2" * 64, "3" * 64


def keys_of(keys):
    return keys.recordings(SCENARIO), keys.trace(SCENARIO, RECORDING), keys.verdicts(SCENARIO, RECORDING, TRACE)


def test_keys_are_pinned():
    assert keys_of(KEYS) == (
        "execute/74/749c3dc748885c132e1d12d13ed6ed7a6c75afa5c1ed5d2163ea358aa58e21f0",
        "observe/be/be14b40a7643032924faa79105527bc614c00360f880453a94500d080dbbb4ac",
        "judge/ff/ff3d642a86fdad016406a217e078ef7e68c23bfbfaa5a5f7a393a40079610f3d-67cf820ad88027d3f7b1d16e6c23e209",
    )
    assert (
        KEYS.evaluation("p" * 64, "ParameterVariationList", {"name": "x"}, SCENARIO)
        == "evaluate/d4/d4d8a3cbb65bb3e8ffe5b55aac5186f22699844ecfb725ed05e7bd0aa7c95d65"
    )


@each_row(
    "changed, stages",
    [
        ({"seed": 1}, [True, False, False]),
        ({"judge_source": "x"}, [False, False, True]),
        ({"oracles": [("success", "s" * 64), ("performance", "q" * 64)]}, [False, False, True]),
        ({"oracles": [("success", "s" * 64), ("speed", "p" * 64)]}, [False, False, True]),
        ({"oracles": [("success", "s" * 64)]}, [False, False, True]),
        ({"oracles": KEYS.oracles[::-1]}, [False, False, False]),
        ({"observe_source": "x"}, [False, True, False]),
        ({"numeric": "aarch64"}, [True, True, True]),
    ],
)
def test_change_affects_only_keys_of_its_stages(changed, stages):
    pairs = zip(keys_of(KEYS), keys_of(replace(KEYS, **changed)), strict=True)
    assert [before != after for before, after in pairs] == stages


@each_row("changed, is_same", [({"oracles": []}, True), ({"judge_source": "x"}, False)])
def test_keys_of_verdicts_of_other_oracles_differ_in_their_end_alone(changed, is_same):
    before, after = (keys_of(keys)[2].rpartition("-") for keys in (KEYS, replace(KEYS, **changed)))
    assert (before[0] == after[0]) == is_same
    assert (before[2] == after[2]) != is_same


def test_numeric_class_is_the_architecture():
    assert numeric_class("x86_64", {"HOME": "/"}) == "x86_64"
    assert numeric_class(environment={}) == platform.machine()


@each_row(
    "setting, is_same",
    [
        *[(f"NUMBA_{name}", False) for name in ("OPT=0", "CPU_FEATURES=+fma", "DISABLE_JIT=1", "NOT_KNOWN_YET=1")],
        ("GLIBC_TUNABLES=glibc.cpu.hwcaps=-FMA", True),
        ("NPY_DISABLE_CPU_FEATURES=AVX2", True),
        *[(f"NUMBA_{name}=1", True) for name in ("CACHE_DIR", "NUM_THREADS", "DUMP_IR", "WARNINGS")],
    ],
)
def test_settings_that_may_change_code_are_in_the_numeric_class(setting, is_same):
    name, _, value = setting.partition("=")
    assert (numeric_class(environment={name: value}) == numeric_class(environment={})) == is_same


def test_numba_file_in_the_working_directory_is_in_the_numeric_class(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = numeric_class()
    (tmp_path / ".numba_config.yaml").write_text("opt: 0\n")
    assert numeric_class() != before
