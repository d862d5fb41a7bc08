"""Addresses of a run: its page, its frames, its layers, and the failed runs around it."""

import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from unpacked import unpacked

from vastflow.deployments.explorer import run_page
from vastflow.deployments.explorer.run_page import around_run
from vastflow.oracles.results.unusable import UnusableDirectory


class NoPool:
    """A pool that starts no process."""

    def __init__(self, workers):
        pass

    def prepare(self, function):
        pass

    def close(self):
        pass


@pytest.fixture(autouse=True)
def no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_page, "Pool", NoPool)


def of(campaign: str, **others: object) -> dict[str, object]:
    return {"c": campaign, "configuration": "quiet-1", "run": 0, **others}


def test_run_page_links_failed_runs_before_and_after(client, add_campaign, id_of):
    campaign = id_of(add_campaign(3, {"noisy": [1], "quiet": [2, 1]}))
    page = client.get("/run", params=of(campaign, run=1)).text
    assert f'data-key="p" href="/run?c={campaign}&amp;configuration=quiet-1&amp;run=0"' in page
    assert f'data-key="n" href="/run?c={campaign}&amp;configuration=quiet-2&amp;run=0"' in page
    assert f'href="/configuration?c={campaign}&amp;name=quiet-1"' in page
    last = client.get("/run", params=of(campaign, configuration="quiet-2", run=3)).text
    assert '<a data-key="p"' in last
    assert '<a data-key="n"' not in last


def test_around_run_finds_failed_runs_in_order_of_configurations(add_campaign):
    directory = add_campaign(3, {"noisy": [1, 0, 2], "a": [1]})
    around = [around_run(directory, *run) for run in (("noisy-1", 0), ("noisy-2", 3), ("noisy-3", 1), ("a-1", 0))]
    first, second, third, last = ("noisy-1", 0), ("noisy-3", 0), ("noisy-3", 1), ("a-1", 0)
    found = [(each["before"], each["after"]) for each in around]
    assert found == [(None, second), (first, second), (second, last), (third, None)]
    assert around[2]["runs"] == {0: "fail", 1: "fail", 2: "pass", 3: "pass"}
    with pytest.raises(UnusableDirectory, match="damaged campaign directory: 9 is not in list"):
        around_run(directory, "a-1", 9)  # whose verdicts lack it


def test_run_page_has_verdicts_time_line_and_signals(client, add_campaign, id_of):
    campaign = id_of(add_campaign(3, {"quiet": [1]}))
    page = client.get("/run", params=of(campaign, **{"with": "quiet-1", "withrun": 1})).text
    assert '<h2>quiet-1, run 0 <strong class="fail">failed</strong></h2>' in page
    assert '<h2>quiet-1, run 1 <strong class="pass">passed</strong></h2>' in page
    assert page.count('<svg class="robot"') == 2 and ">robot A</text>" in page
    speed = re.search(r"<summary>Speed .*?</details>", page, re.DOTALL)[0]
    assert re.findall(r'data-side="(\d)" data-column="(\w+)"', speed) == [("0", "speed_mmps"), ("1", "speed_mmps")]
    assert speed.count('<path d="M0 -0.5L') == 2


def test_run_page_unfolds_signals_of_its_address(client, add_campaign, id_of):
    campaign = id_of(add_campaign(3, {"quiet": [1, 1]}))
    unfolded = r'data-signal="(\w+)" open'
    first = client.get("/run", params=of(campaign)).text
    assert re.findall(unfolded, first)[:3] == ["speed_mmps", "goal_distance_mm", "localization_error_mm"]
    page = client.get("/run", params=of(campaign, signals="yaw_rate_mradps")).text
    assert re.findall(unfolded, page) == ["yaw_rate_mradps"]
    assert "configuration=quiet-2&amp;run=0&amp;signals=yaw_rate_mradps" in page  # the next failed run
    assert re.findall(unfolded, client.get("/run", params=of(campaign, signals="none")).text) == []


def test_frames_reply_is_that_of_the_run(client, add_campaign, id_of):
    campaign = id_of(add_campaign(3, {"quiet": [1]}))
    reply = client.get("/api/frames", params=of(campaign))
    assert reply.headers["content-type"] == "application/octet-stream"
    header, arrays = unpacked(reply.content)
    assert (header["configuration"], header["run"], header["judgment"]) == ("quiet-1", 0, "fail")
    assert len(arrays["t_ms"]) == 20


@pytest.mark.parametrize(
    ("others", "status", "words"),
    [
        ({"run": "x"}, 400, "run: expected a whole number, got 'x'"),
        ({"run": "-1"}, 400, "run: expected a whole number, got '-1'"),
        ({"run": ""}, 400, "run: expected a value in the address, got none"),
        ({"run": 9}, 409, "quiet-1: expected the number of a run, 0 to 3, got 9"),
        ({"configuration": "../quiet-1"}, 409, "Unknown configuration '../quiet-1'"),
        ({"configuration": "<script>"}, 409, "Unknown configuration '<script>'"),
        ({"c": "nowhere"}, 404, "No campaign directory has this id"),
    ],
)
def test_frames_of_wrong_address_are_a_sentence(client, add_campaign, id_of, others, status, words):
    campaign = id_of(add_campaign(3, {"quiet": [1]}))
    reply = client.get("/api/frames", params=of(campaign, **others))
    assert reply.status_code == status
    assert words in reply.json()["error"]


def test_run_page_of_deleted_campaign_is_a_sentence(client, add_campaign, id_of, results: Path):
    directory = add_campaign(3, {"quiet": [1]})
    campaign = id_of(directory)
    (directory / "verdicts.parquet").unlink()
    reply = client.get("/run", params=of(campaign))
    assert reply.status_code == 409
    assert "damaged campaign directory" in reply.text
    directory.rename(results.parent / "elsewhere")
    assert client.get("/run", params=of(campaign)).status_code == 404


@pytest.mark.parametrize("metrics", ["[]", '{"x": [1]}', '{"x": {"value": "a", "unit": 3}}'])
def test_run_page_of_metrics_without_values_is_a_sentence(client, add_campaign, id_of, metrics):
    directory = add_campaign(3, {"quiet": [1]})
    file = directory / "verdicts.parquet"
    table = pq.read_table(file)
    column = table.schema.get_field_index("metrics")
    pq.write_table(table.set_column(column, "metrics", pa.array([metrics] * len(table))), file)
    reply = client.get("/run", params=of(id_of(directory)))
    assert reply.status_code == 409
    assert "expected values with units by name" in reply.text


def test_run_page_offers_runs_of_its_configuration_beside(client, add_campaign, id_of):
    campaign = id_of(add_campaign(3, {"quiet": [2, 1]}))
    page = client.get("/run", params=of(campaign, **{"with": "quiet-1", "withrun": 3})).text
    assert page.count('<option value="3" selected>3 passed</option>') == 1
    assert page.count('<option value="0" selected>0 failed</option>') == 1
    other = client.get("/run", params=of(campaign, **{"with": "quiet-2", "withrun": 3})).text
    assert '<option value="">quiet-2, run 3</option>' in other
    alone = client.get("/run", params=of(campaign, **{"with": "quiet-1", "withrun": ""})).text
    assert '<option value="">none</option>' in alone
