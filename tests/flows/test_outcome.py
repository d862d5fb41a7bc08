"""The outcome of a campaign in the terminal."""

import io
from dataclasses import replace
from functools import partial

import pyarrow as pa
from rich.console import Console

from vastflow.flows.terminal.outcome import details, outcome
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.results.schema import CONFIGURATIONS, JUDGED_RUNS, RUNS, VERDICTS
from vastflow.oracles.results.tables import ConfigurationTable, Tables, VerdictTable


def tables(verdicts, rejections=(), more=(), **metadata):
    names = dict.fromkeys((family, name) for family, name, *_ in verdicts)
    rows = [{"family": family, "name": name, "duplicate_of": None, "scenario": "{}"} for family, name in names]
    rows += more
    configurations = ConfigurationTable(pa.Table.from_pylist(rows, CONFIGURATIONS))
    keys = ("family", "configuration", "run_index", "oracle", "judgment")
    judged = [{**dict(zip(keys, each, strict=True)), "reason": "", "metrics": "{}"} for each in verdicts]
    return Tables(
        directory=None,
        metadata={"name": "c", **metadata},
        campaign="",
        configurations=configurations,
        rejections=list(rejections),
        runs=pa.Table.from_pylist([], RUNS),
        verdicts=VerdictTable(pa.Table.from_pylist(judged, VERDICTS), configurations.names),
    )


def text_of(found, view=outcome):
    console = Console(file=io.StringIO(), width=150, markup=False, highlight=False)
    for part in view(found, evidence_of(found)):
        console.print(part)
    return console.file.getvalue()


def words_of(text, first):
    return next(line.split() for line in text.splitlines() if line.split()[:1] == [first])


PASSES = [("open", "open-1", run, "success", "pass") for run in range(9)]
FAILS = [("tight", "tight-1", run, "success", "fail" if run < 2 else "pass") for run in range(5)]


def test_outcome_has_row_of_each_family_with_wilson_interval_in_80_columns():
    text = text_of(tables(PASSES + FAILS))
    assert words_of(text, "open")[1:5] == ["1", "9", "9", "0"]
    assert "60.0 %  [23.0, 88.3]" in text  # 3 of 5, 23.07 to 88.24 by hand from Wilson's formula, rounded outwards
    assert words_of(text, "all")[1:5] == ["2", "14", "12", "2"]
    assert max(map(len, text.splitlines())) < 80
    assert words_of(text_of(tables(PASSES + FAILS), details), "tight-1")[1:4] == ["5", "3", "2"]


def test_outcome_has_column_of_runs_that_were_not_judged_where_there_are_any():
    text = text_of(tables([*PASSES, ("open", "open-1", 9, "success", "not judged")]))
    assert "not judged" in text and words_of(text, "open")[1:6] == ["1", "10", "9", "0", "1"]
    text = text_of(tables(PASSES))
    assert "not judged" not in text and "all " not in text
    unjudged = [("open", "open-1", run, "success", "not judged") for run in range(5)]
    assert words_of(text_of(tables(unjudged)), "open")[-2:] == ["not", "judged"]


def test_outcome_names_oracles_duplicates_faults_and_saved_runs():
    safety = [("open", "open-1", run, "safety", "fail" if run == 0 else "pass") for run in range(9)]
    faults = [{"configuration": f"open-{k}", "run_index": k, "stage": "execute", "error": "E"} for k in range(5)]
    counts = {"runs": 9, "configurations": 1, "sampled_from": 7, "excluded_by": {"open": {"short": 2}}}
    twin = {"family": "open", "name": "open-2", "duplicate_of": "open-1", "scenario": "{}"}
    text = text_of(tables(PASSES + safety, more=[twin], faults=faults, counts=counts, sequential={"min": 5, "max": 20}))
    for words in (
        "success 9/9, safety 8/9",
        "1 configuration equal to another, run once",
        "9 runs of at most 20, 11 saved, since runs end",
        "a sample of 1 of 7 distinct configurations",
        "2 instances of open excluded by constraints: short 2\n",
        "fault: open-0 run 0, execute: E",
        "and 2 more",
    ):
        assert words in text
    assert "open-3" not in text


def test_outcome_counts_rejections_and_details_list_their_reasons():
    rejections = [
        {"family": family, "producer": "PathVariationRandom", "reason": "no goal [at] 200 m"}
        for family in ("open", "open", "far")
    ]
    found = tables(PASSES, rejections)
    text = text_of(found)
    assert "3 instances rejected" in text and words_of(text, "far")[1:] == ["0", "0", "0", "0", "–"]
    listed = [line.split()[-1] for line in text_of(found, details).splitlines() if "no goal [at] 200 m" in line]
    assert listed == ["2", "1"]


def with_causes(found, *causes):
    """The tables with runs of these configurations, indices, and causes."""
    rows = [dict(zip(("configuration", "run_index", "cause"), each, strict=True)) for each in causes]
    return replace(found, runs=pa.Table.from_pylist(rows, JUDGED_RUNS))


def test_details_name_causes_of_failed_runs_by_configuration():
    causes = [("tight-1", 0, "contact"), ("tight-1", 1, "lost"), ("tight-1", 3, "lost"), ("open-1", 0, None)]
    text = text_of(with_causes(tables(PASSES + FAILS), *causes), details)
    assert next(line for line in text.splitlines() if line.startswith("tight-1")).endswith("lost 2, contact 1")
    assert "causes" not in text_of(tables(PASSES + FAILS), details)


def test_details_of_failing_ones_have_most_failed_first_and_count_the_rest():
    verdicts = [("f", f"f-{k}", run, "success", "fail" if run < k else "pass") for k in range(70) for run in range(70)]
    text = text_of(tables(verdicts), partial(details, failing=True))
    listed = [line.split() for line in text.splitlines() if line.startswith("f-")]
    assert [each[0] for each in listed] == [f"f-{k}" for k in range(69, 19, -1)]
    assert "69 of 70 configurations with failed runs\n" in text and "and 19 more\n" in text
    assert "0 of 1 configuration with failed runs\n" in text_of(tables(PASSES), partial(details, failing=True))
