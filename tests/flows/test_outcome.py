"""What a campaign came to, in the terminal."""

import io

import pyarrow as pa
from rich.console import Console

from vastflow.flows.terminal.outcome import details, outcome, rate_text, rejection_table
from vastflow.oracles.evidence.evidence import evidence_of
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.results.schema import CONFIGURATIONS, RUNS, VERDICTS
from vastflow.oracles.results.tables import ConfigurationTable, Tables
from vastflow.oracles.results.verdict_table import verdict_table


def tables(verdicts, rejections=(), faults=(), more=()):
    names = dict.fromkeys((family, name) for family, name, *_ in verdicts)
    rows = [{"family": family, "name": name, "duplicate_of": None} for family, name in names] + list(more)
    configurations = ConfigurationTable(pa.Table.from_pylist(rows, CONFIGURATIONS))
    return Tables(
        directory=None,
        metadata={"name": "c", "faults": list(faults)},
        campaign="",
        configurations=configurations,
        rejections=list(rejections),
        runs=pa.Table.from_pylist([], RUNS),
        verdicts=verdict_table(
            pa.Table.from_pylist(
                [
                    {
                        "family": family,
                        "configuration": name,
                        "run_index": run,
                        "oracle": oracle,
                        "judgement": judgement,
                        "reason": "",
                        "metrics": "{}",
                    }
                    for family, name, run, oracle, judgement in verdicts
                ],
                VERDICTS,
            ),
            configurations.names,
        ),
    )


def shown(parts):
    console = Console(file=io.StringIO(), width=150, markup=False, highlight=False)
    for part in parts:
        console.print(part)
    return console.file.getvalue()


def text_of(found, view=outcome):
    return shown(view(found, evidence_of(found)))


def words_of(text, first):
    return next(line.split() for line in text.splitlines() if line.split()[:1] == [first])


PASSES = [("open", "open-1", run, "success", "pass") for run in range(9)]
FAILS = [("tight", "tight-1", run, "success", "fail" if run < 2 else "pass") for run in range(5)]


def test_each_family_has_its_rate_with_a_wilson_interval():
    text = text_of(tables(PASSES + FAILS))
    assert words_of(text, "open")[1:5] == ["1", "9", "9", "0"]
    assert "60.0 %  [23.0, 88.3]" in text  # 3 of 5, 23.07 to 88.24 by hand from Wilson's formula, rounded outwards
    assert words_of(text, "all")[1:5] == ["2", "14", "12", "2"]


def test_single_family_has_no_second_row_for_all():
    assert "all " not in text_of(tables(PASSES))


def test_rate_over_no_judged_run_is_said_to_be_not_judged():
    assert rate_text(Counts(0, 0, 5)) == "not judged"


def test_runs_that_were_not_judged_have_a_column_only_where_there_are_any():
    unjudged = [("open", "open-1", 9, "success", "not judged")]
    text = text_of(tables(PASSES + unjudged))
    assert "not judged" in text and words_of(text, "open")[1:6] == ["1", "10", "9", "0", "1"]
    assert "not judged" not in text_of(tables(PASSES))


def test_outcome_fits_a_terminal_of_80_columns():
    assert max(map(len, text_of(tables(PASSES + FAILS)).splitlines())) < 80


def test_family_of_which_nothing_could_be_built_has_a_row():
    rejection = {"family": "far", "producer": "PathVariationRandom", "reason": "too far"}
    assert words_of(text_of(tables(PASSES, [rejection])), "far")[1:] == ["0", "0", "0", "0", "–"]


def test_several_oracles_are_shown_one_by_one():
    safety = [("open", "open-1", run, "safety", "fail" if run == 0 else "pass") for run in range(9)]
    assert "success 9/9  safety 8/9" in text_of(tables(PASSES + safety))


def test_rejections_are_counted_in_the_outcome_and_listed_by_reason_in_the_details():
    rejection = {"family": "open", "producer": "PathVariationRandom", "reason": "no goal [at] 200 m"}
    found = tables(PASSES, [rejection, rejection])
    assert "2 instances rejected" in text_of(found)
    line = next(line for line in text_of(found, details).splitlines() if "no goal [at] 200 m" in line)
    assert line.split()[-1] == "2"
    assert rejection_table(found).row_count == 1


def test_our_own_faults_are_named_and_only_the_first_three_of_many():
    faults = [{"configuration": f"open-{k}", "run_index": k, "stage": "execute", "error": "E"} for k in range(5)]
    text = text_of(tables(PASSES, faults=faults))
    assert "fault: open-0 run 0, execute: E" in text and "and 2 more" in text and "open-3" not in text


def test_duplicates_are_said():
    found = tables(PASSES, more=[{"family": "open", "name": "open-2", "duplicate_of": "open-1"}])
    assert "1 configuration equal to another, run once" in text_of(found)


def test_details_have_a_row_for_each_configuration():
    text = text_of(tables(PASSES + FAILS), details)
    assert words_of(text, "tight-1")[1:4] == ["5", "3", "2"]
