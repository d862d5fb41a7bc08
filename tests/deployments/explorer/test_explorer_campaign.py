"""The pages of campaigns and configurations, and what they ask the server for."""

import io
import json
import shutil
from base64 import b64decode
from collections import Counter
from datetime import datetime

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from pocket import SCENARIO, computed, file_of
from table import each_row

from vastflow.deployments.explorer.directories import Directories
from vastflow.oracles.evidence.wide import WIDE_FILE
from vastflow.oracles.page.report import write_report
from vastflow.oracles.results.events import EVENTS, Event
from vastflow.oracles.results.unfinished import WRITER, writer

FAMILIES = {"easy": [0, 0, 1], "hard": [4, 2]}


@pytest.fixture
def campaign(add_campaign, id_of):
    """A campaign of five configurations and twenty runs, seven of which failed; its id and directory."""
    directory = add_campaign(3, FAMILIES)
    return id_of(directory), directory


def arrays_of(content):
    """A packed reply: its header, and the arrays in their order."""
    line, _, rest = content.partition(b"\n")
    header = json.loads(line)
    told = header["arrays"].values()
    sizes = [int(np.prod(each["shape"])) for each in told]
    found = [np.frombuffer(rest, each["type"], n, each["offset"]) for each, n in zip(told, sizes, strict=True)]
    return header, found


def read_whole(client, address, **query):
    """The reply of paths once all are read."""
    for _ in range(200):
        header, arrays = arrays_of(client.get(address, params=query).content)
        if header["read"] == header["configurations_here"] or header["problem"]:
            return header, arrays
    raise AssertionError("the paths were not read")


def test_campaign_page_names_the_campaign(client, campaign):
    page = client.get("/campaign", params={"c": campaign[0]})
    assert page.status_code == 200
    assert "<h1>office" in page.text
    assert "/static/campaign.js" in page.text


def test_campaign_page_opens_with_findings_classes_report_and_file(client, campaign):
    c, directory = campaign
    page = client.get("/campaign", params={"c": c}).text
    assert "Open the report" not in page and "findings" not in page
    assert "name: office" in page
    assert client.get("/report", params={"c": c}).status_code == 404
    write_report(directory)
    classes = Counter(json.loads((directory / "evidence.json").read_text())["classes"]["configurations"].values())
    page = client.get("/campaign", params={"c": c}).text
    for name, n in classes.items():
        assert f"<b>{n}</b> {name}" in page
    assert "Of 5 configurations, 2 passed in every judged run, 1 failed in every one" in page
    assert f'href="/report?c={c}"' in page
    report = client.get("/report", params={"c": c})
    assert report.content == (directory / "report.html").read_bytes()
    assert report.headers["content-security-policy"].startswith("sandbox; default-src 'none'; ")


@pytest.mark.parametrize(("many", "folded"), [(4, ""), (7, "<summary>3 more</summary><ul><li>finding 4</li>")])
def test_campaign_page_folds_findings_beyond_the_first_four(client, campaign, many, folded):
    c, directory = campaign
    (directory / "evidence.json").write_text(json.dumps({"findings": [f"finding {k}" for k in range(many)]}))
    page = client.get("/campaign", params={"c": c}).text
    assert page.count("<li>finding ") == many
    assert folded in page and (" more</summary>" in page) == bool(folded)


@each_row(
    "content",
    [
        "{",
        "[]",
        '{"findings": 3, "classes": {"configurations": [1]}}',
        '{"classes": {"configurations": {"hard-1": 1}}}',
    ],
)
def test_campaign_page_does_without_strange_evidence(client, campaign, content):
    c, directory = campaign
    (directory / "evidence.json").write_text(content)
    assert "Configurations: " not in client.get("/campaign", params={"c": c}).text
    assert client.get("/api/configuration", params={"c": c, "name": "hard-1"}).json()["class"] is None


def test_reasons_are_those_of_oracles_grouped_as_in_the_report(client, campaign):
    c, directory = campaign
    verdicts = pd.read_parquet(directory / "verdicts.parquet")
    late = (verdicts["configuration"] == "hard-1") & (verdicts["judgment"] == "fail")
    verdicts.loc[late, "reason"] = [f"drove {k} m too far" for k in range(late.sum())]
    verdicts.to_parquet(directory / "verdicts.parquet")
    far, stuck = client.get("/api/summary", params={"c": c}).json()["kinds"]
    assert (far["oracle"], far["runs"], far["configurations"], far["reasons"]) == ("success", 4, 1, 4)
    assert (stuck["runs"], stuck["configurations"]) == (3, 2)
    (far,) = client.get("/api/summary", params={"c": c, "f": "configuration=hard-1;run_index:1.."}).json()["kinds"]
    assert (far["runs"], far["configuration"], far["run_index"]) == (3, "hard-1", 1)
    html = client.get("/api/summary", params={"c": c}, headers={"accept": "text/html"}).text
    assert "none given" not in html and "drove 0 m too far" in html


def test_configuration_has_class_and_interval(client, campaign):
    c, directory = campaign
    write_report(directory)
    classes = json.loads((directory / "evidence.json").read_text())["classes"]["configurations"]
    page = client.get("/configuration", params={"c": c, "name": "hard-1"}).text
    assert "95 % interval 0.0–49.0 %" in page and f"<b>{classes['hard-1']}</b>" in page


def test_rows_of_runs_chosen_by_result_have_no_interval(client, campaign):
    whole, failed = (client.get("/api/rows", params={"c": campaign[0], "f": f}).json() for f in ("", "passed=fail"))
    assert all(row["interval"] for row in whole["rows"])
    assert [row["interval"] for row in failed["rows"]] == [None, None, None]


def test_campaign_page_shows_faults_and_rejections(client, campaign):
    assert "rejected" not in client.get("/campaign", params={"c": campaign[0]}).text
    file = campaign[1] / "metadata.json"
    metadata = json.loads(file.read_text())
    fault = {"configuration": "hard-3", "run_index": 1, "stage": "execute", "error": "<b>killed</b>"}
    metadata["counts"]["rejected"], metadata["faults"] = 2, [fault, "odd", fault]
    file.write_text(json.dumps(metadata))
    page = client.get("/campaign", params={"c": campaign[0]}).text
    assert "2 faults</span>, 2 rejected instances" in page
    assert "<li>execute, hard-3: &lt;b&gt;killed&lt;/b&gt;</li>" in page
    for text in ('{"faults": {"a": 1}}', "{"):
        file.write_text(text)
        assert client.get("/campaign", params={"c": campaign[0]}).status_code == 200


def test_summary_counts_selection_and_gives_canonical_filter(client, campaign):
    found = client.get("/api/summary", params={"c": campaign[0], "f": "passed=fail;family=hard"}).json()
    assert found["filter"] == "family=hard;passed=fail"
    assert (found["summary"]["runs"], found["summary"]["failed"], found["summary"]["all_runs"]) == (6, 6, 20)
    names = {}
    exec(found["python"], names)  # noqa: S102
    assert len(names["selection"]) == 6
    assert found["maps"][0]["runs"] == 20


def test_campaign_without_wide_table_is_one_sentence(client, campaign):
    c, directory = campaign
    (directory / WIDE_FILE).unlink()
    reply = client.get("/api/summary", params={"c": c})
    assert (reply.status_code, WIDE_FILE in reply.json()["error"]) == (409, True)


def test_campaign_is_read_anew_when_its_table_changes(client, campaign):
    c, directory = campaign
    assert client.get("/api/summary", params={"c": c}).json()["summary"]["runs"] == 20
    pd.read_parquet(directory / WIDE_FILE).head(8).to_parquet(directory / WIDE_FILE)
    assert client.get("/api/summary", params={"c": c}).json()["summary"]["runs"] == 8


def test_rows_are_sorted_and_link_by_name(client, campaign):
    found = client.get("/api/rows", params={"c": campaign[0], "sort": "rate", "count": 2}).json()
    assert [row["configuration"] for row in found["rows"]] == ["hard-1", "hard-2"]
    assert (found["total"], found["rows"][0]["rate"]) == (5, 0.0)


def test_points_have_axes_that_vary(client, campaign):
    header, arrays = arrays_of(client.get("/api/points", params={"c": campaign[0]}).content)
    assert "noise" in [each["name"] for each in header["columns"]]
    assert header["shown"] == header["total"] == 20 == len(arrays[0])


@pytest.mark.parametrize("layer", ["paths", "ends", "rate"])
def test_map_has_layers_of_the_selection(client, campaign, layer):
    environment = client.get("/api/summary", params={"c": campaign[0]}).json()["maps"][0]["id"]
    query = {"c": campaign[0], "environment": environment, "layer": layer, "f": "passed=fail"}
    header, _ = read_whole(client, "/api/paths", **query)
    assert header["runs"] == 7
    assert header["form"] == ("grid" if layer == "rate" else "runs")
    assert header["floor"]["width"] == pytest.approx(6.0)
    kind, _, content = header["floor"]["picture"].partition(",")
    assert kind == "data:image/png;base64"
    assert Image.open(io.BytesIO(b64decode(content))).size == (120, 80)


@each_row("form, read", [("csv", pd.read_csv), ("parquet", pd.read_parquet)])
def test_table_of_the_selection_is_a_file(client, campaign, form, read):
    reply = client.get("/api/table", params={"c": campaign[0], "f": "passed=fail", "format": form})
    assert reply.headers["Content-Disposition"].endswith(f'-7-runs.{form}"')
    found = read(io.BytesIO(reply.content))
    expected = pd.read_parquet(campaign[1] / WIDE_FILE)
    assert found.columns.tolist() == expected.columns.tolist()
    assert found["run_index"].tolist() == expected[expected["passed"].eq(False)]["run_index"].tolist()


def test_configuration_has_runs_events_and_neighbor(client, campaign):
    query = {"c": campaign[0], "name": "hard-2"}
    assert client.get("/configuration", params=query).status_code == 200
    found = client.get("/api/configuration", params=query).json()
    assert [run["verdict"] for run in found["runs"]] == ["fail", "fail", "pass", "pass"]
    assert found["runs"][0]["reason"] == "stuck"
    assert found["neighbor"]["name"] == "easy-2"
    assert "noise" not in [each["name"] for each in found["neighbor"]["differences"]]
    assert found["around"]["start"] == [1.0, 2.0]
    assert len(found["around"]["goals"]) == 1
    header, arrays = arrays_of(client.get("/api/configuration/paths", params=query).content)
    assert header["runs"] == 4
    assert arrays[-1].tolist() == [1, 1, 0, 0]


def test_signals_are_over_time_or_distance(client, campaign):
    query = {"c": campaign[0], "name": "hard-2", "signal": "speed_mps"}
    _, (x, y, starts, runs, verdicts) = arrays_of(client.get("/api/configuration/signals", params=query).content)
    assert (runs.tolist(), verdicts.tolist(), starts.tolist()) == ([0, 1, 2, 3], [1, 1, 0, 0], [0, 20, 40, 81, 122])
    assert x[starts[3] : starts[4]].tolist() == pytest.approx(np.arange(41) * 0.1)
    assert y.tolist() == pytest.approx([0.5] * 122)
    query["over"] = "distance_m"
    _, (x, *_) = arrays_of(client.get("/api/configuration/signals", params=query).content)
    assert x[starts[3] : starts[4]].max() == pytest.approx(4.0)


@each_row(
    "address, query, message",
    [
        ("/api/facets", {"f": "nothing=1"}, "expected a column of this campaign, got 'nothing'"),
        ("/api/rows", {"sort": "nothing"}, "expected a column of this campaign, got 'nothing'"),
        ("/api/rows", {"start": "-1"}, "start: expected a whole number, got '-1'"),
        ("/api/paths", {"environment": "../.."}, "environment: expected a map of this campaign, got '../..'"),
        ("/api/table", {"format": "exe"}, "format: expected csv or parquet, got 'exe'"),
        (
            "/api/configuration",
            {"name": "../x"},
            "name: expected a configuration with runs in this campaign, got '../x'",
        ),
        ("/api/configuration", {}, "name: expected a value in the address, got none"),
    ],
)
def test_wrong_request_is_one_sentence(client, campaign, address, query, message):
    reply = client.get(address, params={"c": campaign[0], **query})
    assert 400 <= reply.status_code < 500
    assert reply.json() == {"error": message}


@each_row("name", [WIDE_FILE, "configurations.parquet"])
def test_damaged_table_is_one_sentence(client, add_campaign, id_of, tmp_path, name):
    directory = add_campaign(4, FAMILIES, name=f"broken-{name[0]}")
    (directory / name).write_bytes((directory / name).read_bytes()[:-200])
    page = client.get("/campaign", params={"c": id_of(directory)})
    assert page.status_code == 409
    assert f"{name.split('.')[0]}" in page.text
    assert client.get("/api/summary", params={"c": id_of(directory)}).status_code == 409


def test_damaged_recordings_are_counted_on_the_map(client, campaign):
    c, directory = campaign
    (directory / "recordings" / "hard-1.parquet").write_bytes(b"PAR1")
    environment = client.get("/api/summary", params={"c": c}).json()["maps"][0]["id"]
    header, _ = read_whole(client, "/api/paths", c=c, environment=environment)
    assert (header["damaged"], header["runs"]) == (1, 16)
    reply = client.get("/api/configuration", params={"c": c, "name": "hard-1"})
    assert reply.status_code == 409
    assert "damaged campaign directory" in reply.json()["error"]


def test_map_reports_damage_in_its_place(client, campaign):
    c, directory = campaign
    environment = client.get("/api/summary", params={"c": c}).json()["maps"][0]["id"]
    (directory / "environments" / environment / "map.yaml").write_text("image: 3")
    header, _ = read_whole(client, "/api/paths", c=c, environment=environment)
    assert header["problem"]
    assert header["form"] == "nothing"


def test_running_campaign_is_sent_to_its_progress(client, results):
    place = results / ".office-2026-11-21-060000.running"
    place.mkdir()
    (place / WRITER).write_text(json.dumps(writer()))
    (place / EVENTS).write_bytes(Event(datetime.now().astimezone(), "began", {"name": "office"}).line)
    (running,) = Directories([results]).all()
    page = client.get("/campaign", params={"c": running.id})
    assert (page.status_code, page.headers["location"]) == (303, f"/live?c={running.id}")
    assert "it is still running" in client.get("/api/summary", params={"c": running.id}).json()["error"]


def test_removed_campaign_gives_one_sentence(client, campaign):
    c, directory = campaign
    assert client.get("/api/summary", params={"c": c}).status_code == 200
    shutil.rmtree(directory)
    assert client.get("/campaign", params={"c": c}).status_code == 404
    assert "No campaign directory" in client.get("/api/rows", params={"c": c}).json()["error"]


def test_names_of_a_hostile_table_lead_out_of_no_folder(client, campaign, tmp_path):
    c, directory = campaign
    (directory / "recordings" / "hard-1.parquet").rename(tmp_path / "hard-1.parquet")
    (directory / "recordings" / "hard-1.parquet").symlink_to(tmp_path / "hard-1.parquet")
    (directory / "recordings" / "hard-2.parquet").rename(directory / "hard-2.parquet")
    runs = pd.read_parquet(directory / WIDE_FILE)
    runs["configuration"] = runs["configuration"].cat.rename_categories({"hard-2": "../hard-2"})
    runs.to_parquet(directory / WIDE_FILE)
    for name in ("hard-1", "../hard-2"):
        found = client.get("/api/configuration", params={"c": c, "name": name}).json()
        assert [run["recorded"] for run in found["runs"]] == [False] * 4
        header, _ = arrays_of(client.get("/api/configuration/paths", params={"c": c, "name": name}).content)
        assert header["form"] == "nothing"


def test_runs_in_disorder_are_one_sentence(client, campaign):
    c, directory = campaign
    pd.read_parquet(directory / WIDE_FILE).iloc[::-1].to_parquet(directory / WIDE_FILE)
    assert "one after another" in client.get("/api/rows", params={"c": c}).json()["error"]


def test_names_are_text_on_every_page(client, add_campaign, id_of):
    evil = "<script>alert(1)</script>"
    c = id_of(add_campaign(5, FAMILIES, name="evil", text=f"version: 1\nmetadata: {{name: '{evil}'}}\n"))
    for page in (
        client.get("/configuration", params={"c": c, "name": evil}),
        client.get("/campaign", params={"c": evil}),
        client.get("/campaign", params={"c": c, "f": evil}),
    ):
        assert evil not in page.text


def test_campaign_without_map_and_metrics_has_its_other_views(client, campaign):
    c, directory = campaign
    runs = pd.read_parquet(directory / WIDE_FILE)
    runs[["configuration", "run_index", "passed"]].to_parquet(directory / WIDE_FILE)
    configurations = pd.read_parquet(directory / "configurations.parquet")
    configurations["environment"] = None
    configurations.to_parquet(directory / "configurations.parquet")
    found = client.get("/api/summary", params={"c": c}).json()
    assert (found["maps"], found["summary"]["failed"], found["reasons"]["reason"]["rows"]) == ([], 7, [])
    assert client.get("/api/facets", params={"c": c}).json()["facets"][0]["name"] == "passed"
    assert client.get("/api/rows", params={"c": c}).json()["total"] == 5
    assert arrays_of(client.get("/api/points", params={"c": c}).content)[0]["columns"] == []
    assert client.get("/api/configuration", params={"c": c, "name": "hard-2"}).json()["family"] is None
    header, _ = arrays_of(client.get("/api/configuration/paths", params={"c": c, "name": "hard-2"}).content)
    assert header["problem"] == "This scenario has no map."


def test_maps_without_map_are_called_by_their_worlds(client, campaign):
    c, directory = campaign
    columns = pd.read_parquet(directory / WIDE_FILE).drop(columns="map_file", errors="ignore")
    columns.assign(world="world_12").to_parquet(directory / WIDE_FILE)
    assert {each["name"] for each in client.get("/api/summary", params={"c": c}).json()["maps"]} == {"world_12"}


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """The directory of a search for times: four points of two runs, the best with ten more."""
    place = tmp_path_factory.mktemp("pocket")
    (place / "campaign").mkdir()
    (place / "campaign" / "pocket.osc").write_text(SCENARIO)
    file = file_of(place, more="  budget: [{batches: 1}]", runs="2")
    return computed(file, place, "store", workers=1).directory


def test_campaign_page_of_search_has_points_with_their_dimensions(client, results, searched, id_of):
    c = id_of(shutil.copytree(searched, results / searched.name))
    assert client.get("/campaign", params={"c": c}).status_code == 200
    found = client.get("/api/summary", params={"c": c}).json()
    assert (found["summary"]["runs"], found["summary"]["configurations"]) == (18, 4)
    facets = {each["name"]: each for each in client.get("/api/facets", params={"c": c}).json()["facets"]}
    assert facets["x"]["group"] == facets["n"]["group"] == "factor"
    rows = client.get("/api/rows", params={"c": c, "sort": "runs", "order": "descending"}).json()["rows"]
    assert [row["passed"] + row["failed"] for row in rows] == [12, 2, 2, 2]
    best = json.loads((searched / "metadata.json").read_text())["search"]["best"]
    assert (rows[0]["configuration"], rows[0]["values"][0]) == (
        best["configuration"],
        pytest.approx(best["point"]["x"]),
    )
    chosen = f"x:{best['point']['x'] - 0.01}..{best['point']['x'] + 0.01}"
    assert client.get("/api/summary", params={"c": c, "f": chosen}).json()["summary"]["runs"] == 12
    header, arrays = arrays_of(client.get("/api/points", params={"c": c}).content)
    assert {"x", "n"} <= {each["name"] for each in header["columns"]} and len(arrays[0]) == 18
    assert client.get("/configuration", params={"c": c, "name": best["configuration"]}).status_code == 200
    page = client.get("/run", params={"c": c, "configuration": best["configuration"], "run": "11"})
    assert page.status_code == 200
