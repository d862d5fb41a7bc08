import sys
from dataclasses import replace

from table import each_row

from vastflow.tasks.keys.keys import Keys, numeric_class

KEYS = Keys(
    numeric="x86_64; glibc 2.36; avx2 fma; ",
    execute_source="e" * 64,
    observe_source="o" * 64,
    judge_source="j" * 64,
    seed=0,
    oracles=[["success", {}], ["performance", {"rmse_threshold": 0.5}]],
)
SCENARIO, RECORDING, TRACE = "1" * 64, "2" * 64, "3" * 64


def test_keys_are_pinned():
    assert KEYS.recordings(SCENARIO) == "execute/74/749c3dc748885c132e1d12d13ed6ed7a6c75afa5c1ed5d2163ea358aa58e21f0"
    assert (
        KEYS.trace(SCENARIO, RECORDING) == "observe/be/be14b40a7643032924faa79105527bc614c00360f880453a94500d080dbbb4ac"
    )
    assert (
        KEYS.verdicts(SCENARIO, RECORDING, TRACE)
        == "judge/2b/2bacf7ebf3260a2487ceac7361b4a97f825ac20ad325c4d8d682da1309b8eaab"
    )
    assert (
        KEYS.evaluation("p" * 64, "ParameterVariationList", {"name": "x"}, SCENARIO)
        == "evaluate/d4/d4d8a3cbb65bb3e8ffe5b55aac5186f22699844ecfb725ed05e7bd0aa7c95d65"
    )


def test_seed_is_in_the_key_of_recordings_alone():
    other = replace(KEYS, seed=1)
    assert other.recordings(SCENARIO) != KEYS.recordings(SCENARIO)
    assert other.trace(SCENARIO, RECORDING) == KEYS.trace(SCENARIO, RECORDING)


def test_oracles_parameter_is_in_the_key_of_verdicts_alone():
    other = replace(KEYS, oracles=[["success", {}], ["performance", {"rmse_threshold": 0.6}]])
    assert other.recordings(SCENARIO) == KEYS.recordings(SCENARIO)
    assert other.trace(SCENARIO, RECORDING) == KEYS.trace(SCENARIO, RECORDING)
    assert other.verdicts(SCENARIO, RECORDING, TRACE) != KEYS.verdicts(SCENARIO, RECORDING, TRACE)


def test_code_of_a_stage_is_in_its_own_keys():
    other = replace(KEYS, observe_source="x")
    assert other.recordings(SCENARIO) == KEYS.recordings(SCENARIO)
    assert other.trace(SCENARIO, RECORDING) != KEYS.trace(SCENARIO, RECORDING)


def test_another_numeric_class_shares_nothing():
    other = replace(KEYS, numeric="aarch64")
    assert other.recordings(SCENARIO) != KEYS.recordings(SCENARIO)
    assert other.trace(SCENARIO, RECORDING) != KEYS.trace(SCENARIO, RECORDING)
    assert other.verdicts(SCENARIO, RECORDING, TRACE) != KEYS.verdicts(SCENARIO, RECORDING, TRACE)


def test_numeric_class_names_what_selects_variants_of_functions():
    features = frozenset({"fma", "avx2", "sse4_2", "hypervisor"})
    named = numeric_class("x86_64", "glibc 2.36", features, {"HOME": "/"}, "3.13")
    assert named == "x86_64; glibc 2.36; avx2 fma; ; 3.13"


def test_forced_variant_of_the_c_library_is_another_class():
    plain = numeric_class("x86_64", "glibc 2.36", frozenset(), {})
    assert numeric_class("x86_64", "glibc 2.36", frozenset(), {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA"}) != plain


def test_this_hosts_class_is_the_same_each_time():
    assert numeric_class() == numeric_class() != ""


def test_another_minor_version_of_python_is_another_class():
    classes = {numeric_class("x86_64", "glibc 2.36", frozenset(), {}, python) for python in ("3.11", "3.12")}
    assert len(classes) == 2
    assert numeric_class().endswith(f"; {sys.version_info.major}.{sys.version_info.minor}")


@each_row(
    "variable",
    [
        "NUMBA_OPT=0",
        "NUMBA_CPU_FEATURES=+fma",
        "NUMBA_DISABLE_JIT=1",
        "NUMBA_LOOP_VECTORIZE=0",
        "NUMBA_NOT_KNOWN_YET=1",
    ],
)
def test_setting_that_may_change_compiled_code_is_another_class(variable):
    name, _, value = variable.partition("=")
    assert numeric_class(environment={name: value}) != numeric_class(environment={})


@each_row("name", ["NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS", "NUMBA_DUMP_IR", "NUMBA_WARNINGS"])
def test_setting_that_changes_no_code_changes_no_class(name):
    assert numeric_class(environment={name: "1"}) == numeric_class(environment={})


def test_numbas_file_in_the_working_directory_is_another_class(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = numeric_class()
    (tmp_path / ".numba_config.yaml").write_text("opt: 0\n")
    assert numeric_class() != before
