"""Outputs of programs on a run's page: a link for each file, and plots of tables."""

import numpy as np
import pytest

from vastflow.deployments.explorer import outputs
from vastflow.sim.model.archive import MAX_UNPACKED_BYTES, write_outputs
from vastflow.sim.model.recording import Outputs

HTML = b"<script>alert(1)</script>"


@pytest.fixture
def campaign(add_campaign):
    """A directory whose first run wrote two files and a table."""
    directory = add_campaign(3, {"quiet": [0]})
    table = {
        "t_s": np.linspace(10.0, 20.0, 5001),
        "word": np.array(["a"] * 5001, dtype=object),
        "height_m": np.r_[np.linspace(-1.0, 3.0, 5000), np.nan],
    }
    wrote = Outputs({"flight.csv": table}, {"pages/a b.html": HTML, "log.txt": b"x" * 1234})
    (directory / "outputs").mkdir(exist_ok=True)
    archive = write_outputs({0: wrote, 1: Outputs({}, {"secret.txt": b"of another run"})})
    (directory / "outputs/quiet-1.zip").write_bytes(archive)
    return directory


def of(c, **others):
    return {"c": c, "configuration": "quiet-1", "run": 0, **others}


def test_run_page_lists_files_with_sizes_and_plots_columns_of_numbers(client, campaign, id_of):
    page = client.get("/run", params=of(id_of(campaign))).text
    assert 'name=files%2Flog.txt" download>files/log.txt</a> <span class="muted">1,234 bytes</span>' in page
    assert 'name=tables%2Fflight.csv.parquet" download>' in page
    assert "flight.csv: height_m over t_s from 10 to 20" in page and "word over" not in page
    assert "secret.txt" not in page and 'data-column=""' not in page
    assert "Written by programs" not in client.get("/run", params=of(id_of(campaign), run=2)).text


def test_plot_of_a_table_spans_its_ranges_in_few_points(campaign):
    (plot,) = outputs.written_by(campaign, "quiet-1", 0)["plots"]
    assert (plot["low"], plot["drawn"]) == (-1.0, (0, 1))
    assert plot["high"] == pytest.approx(3.0, abs=1e-2)
    drawn = plot["lines"][0]["d"]
    assert drawn.count("M") == 1
    assert drawn.count("L") < outputs.MOST_ROWS


def test_file_of_a_program_is_saved_and_never_shown(client, campaign, id_of):
    reply = client.get("/output", params=of(id_of(campaign), name="files/pages/a b.html"))
    assert (reply.status_code, reply.content) == (200, HTML)
    assert reply.headers["content-type"] == "application/octet-stream"
    assert reply.headers["content-disposition"] == "attachment; filename*=UTF-8''a%20b.html"
    assert reply.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "name", ["files/none", "files/secret.txt", "../metadata.json", "/etc/passwd", "files", "0/files/log.txt"]
)
def test_name_reads_members_alone(client, campaign, id_of, name):
    assert client.get("/output", params=of(id_of(campaign), name=name)).status_code == 404


def test_damaged_or_oversized_outputs_are_a_sentence(client, campaign, id_of, monkeypatch):
    monkeypatch.setattr(outputs, "MAX_UNPACKED_BYTES", 1000)
    reply = client.get("/output", params=of(id_of(campaign), name="files/log.txt"))
    assert reply.status_code == 409 and "1,234 bytes in 0/files/log.txt" in reply.text
    monkeypatch.setattr(outputs, "MAX_UNPACKED_BYTES", MAX_UNPACKED_BYTES)
    (campaign / "outputs/quiet-1.zip").write_bytes(b"PK no archive")
    for address in ("/run", "/output"):
        reply = client.get(address, params=of(id_of(campaign), name="files/log.txt"))
        assert reply.status_code == 409 and "damaged campaign directory" in reply.text
