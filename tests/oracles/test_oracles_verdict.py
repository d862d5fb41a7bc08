import pytest

from vastflow.oracles.verdict import Judgement, Metric, Verdict, read_verdicts, run_judgement, write_verdicts

VERDICTS = [
    Verdict("success", 0, "pass", "", {"time": Metric(12.5, "s"), "final_distance": Metric(None, "m")}),
    Verdict("performance", 0, "not judged", "no reference path: the scenario has no map", {}),
]


def test_verdicts_survive_writing_and_reading() -> None:
    assert read_verdicts(write_verdicts(VERDICTS)) == VERDICTS


def test_verdicts_are_written_in_one_pinned_form() -> None:
    assert write_verdicts(VERDICTS[1:]) == (
        b'[{"judgement":"not judged","metrics":{},"oracle":"performance",'
        b'"reason":"no reference path: the scenario has no map","run_index":0}]'
    )


def test_a_metric_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_verdicts([Verdict("success", 0, "pass", "", {"time": Metric(float("nan"), "s")})])


@pytest.mark.parametrize(
    ("judgements", "together"),
    [
        (["pass", "pass"], "pass"),
        (["pass", "fail"], "fail"),
        (["not judged", "fail"], "fail"),
        (["pass", "not judged"], "not judged"),
        ([], "not judged"),
    ],
)
def test_a_run_passes_when_all_pass_and_fails_when_one_fails(judgements: list[Judgement], together: str) -> None:
    assert run_judgement(judgements) == together
