import pytest
from table import each_row

from vastflow.oracles.judgement.verdict import Judgement, Metric, Verdict, read_verdicts, run_judgement, write_verdicts

VERDICTS = [
    Verdict("success", 0, "pass", "", {"time": Metric(12.5, "s"), "final_distance": Metric(None, "m")}),
    Verdict("performance", 0, "not judged", "no reference path: the scenario has no map", {}),
]


def test_verdicts_survive_writing_and_reading() -> None:
    assert read_verdicts(write_verdicts(VERDICTS)) == VERDICTS


def test_verdicts_are_written_in_one_pinned_form() -> None:
    assert write_verdicts(VERDICTS) == (
        rb'[{"judgement":"pass","metrics":"{\"final_distance\":{\"value\":null,\"unit\":\"m\"},'
        rb'\"time\":{\"value\":12.5,\"unit\":\"s\"}}","oracle":"success","reason":"","run_index":0},'
        rb'{"judgement":"not judged","metrics":"{}","oracle":"performance",'
        rb'"reason":"no reference path: the scenario has no map","run_index":0}]'
    )


def test_metrics_that_were_read_are_written_again_as_they_were() -> None:
    written = write_verdicts(VERDICTS)
    read = read_verdicts(written)
    assert write_verdicts(read) == written
    assert read[0].metrics["time"] == Metric(12.5, "s") and list(read[0].metrics) == ["final_distance", "time"]
    assert repr(read[1].metrics) == "{}" and VERDICTS[0].metrics == read[0].metrics != VERDICTS[1].metrics


def test_reason_may_hold_what_no_text_file_can() -> None:
    said = [Verdict("success", 0, "fail", "a program wrote \ud800")]
    assert read_verdicts(write_verdicts(said)) == said


def test_metric_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_verdicts([Verdict("success", 0, "pass", "", {"time": Metric(float("nan"), "s")})])


@each_row(
    ("judgements", "together"),
    [
        (["pass", "pass"], "pass"),
        (["pass", "fail"], "fail"),
        (["not judged", "fail"], "fail"),
        (["pass", "not judged"], "not judged"),
        ([], "not judged"),
    ],
)
def test_run_passes_when_all_pass_and_fails_when_one_fails(judgements: list[Judgement], together: str) -> None:
    assert run_judgement(judgements) == together
