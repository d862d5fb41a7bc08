"""Results on S3: a campaign directory is uploaded when it is finished, its `metadata.json` last."""

import json
import os
import time

import fsspec
import pytest
from bench_pipeline import SCENARIO, campaign_text
from command_line import refused

from vastflow.flows.results.address import delivery_to
from vastflow.flows.results.summary import Results, Summary
from vastflow.tasks.store.remote_files import file_system
from vastflow.tasks.store.store import StoreError, open_store


@pytest.fixture
def store(tmp_path):
    return open_store(tmp_path / "store")


def written(folder):
    """A campaign directory in `folder`, as far as a delivery looks at it."""
    directory = folder / "hall-2026-11-22-000000"
    (directory / "recordings").mkdir(parents=True)
    (directory / "recordings" / "hall-1.parquet").write_bytes(b"recordings")
    (directory / "report.html").write_text("<html>")
    (directory / "metadata.json").write_text(json.dumps({"name": "hall", "counts": {"results": str(directory)}}))
    summary = Summary(*[0] * 9, 0.0, 0.0, 0.0, str(directory), {})
    return Results(directory, summary, (), ())


def test_results_folder_contains_new_directory(store, tmp_path):
    found = delivery_to(tmp_path / "results", store)
    assert (found.folder, found.address) == (tmp_path / "results", None)
    results = written(found.folder)
    assert found.delivered(results) is results


def test_directory_is_uploaded_completely_with_its_address(store, shared_s3, s3_variables):
    s3_variables(shared_s3)
    found = delivery_to("s3://bucket/reports/", store)
    results = found.delivered(written(found.folder))
    address = "s3://bucket/reports/hall-2026-11-22-000000"
    assert (results.summary.results, results.directory.parent) == (address, found.folder)
    files, root = file_system(address)
    assert {path.removeprefix(f"{root}/") for path in files.find(root)} == {
        "metadata.json",
        "recordings/hall-1.parquet",
        "report.html",
    }
    assert json.loads(files.cat_file(f"{root}/metadata.json"))["counts"]["results"] == address


def test_half_an_upload_is_no_campaign_directory_and_the_copy_here_is_named(
    store, shared_s3, s3_variables, monkeypatch
):
    s3_variables(shared_s3)
    found = delivery_to("s3://bucket/half", store)
    system, root = file_system("s3://bucket/half")

    def broken(*_, **__):
        system.pipe_file(f"{root}/hall-2026-11-22-000000/report.html", b"<html>")
        raise OSError("the network is away")

    monkeypatch.setattr(system, "put", broken)
    monkeypatch.setattr("vastflow.tasks.store.remote_files.file_system", lambda _address: (system, root))
    with pytest.raises(StoreError, match=r"results: can't use 's3://bucket/half' .*\. The campaign directory is in "):
        found.delivered(written(found.folder))
    assert not system.exists(f"{root}/hall-2026-11-22-000000/metadata.json")
    assert list(found.folder.glob("*/report.html"))


def test_copies_of_earlier_days_go(store, shared_s3, s3_variables):
    s3_variables(shared_s3)
    folder = delivery_to("s3://bucket/old", store).folder
    for name, age_s in (("old", 2 * 86400), ("new", 60)):
        (folder / name).mkdir(parents=True)
        os.utime(folder / name, (time.time() - age_s,) * 2)
    delivery_to("s3://bucket/old", store)
    assert [path.name for path in folder.iterdir()] == ["new"]


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("s3://no-such-bucket/x", "results: can't use 's3://no-such-bucket/x'"),
        ("nowhere://x", "Give a folder, or an address such as s3://bucket/prefix"),
    ],
)
def test_unwritable_address_is_refused_before_computing(tmp_path, shared_s3, s3_variables, address, said):
    s3_variables(shared_s3)
    (tmp_path / "nothing.vast").write_text(campaign_text(1, 1, edited=0))
    (tmp_path / "nothing.osc").write_text(SCENARIO)
    options = ["--results", address, "--store", str(tmp_path / "store")]
    assert said in refused("run", tmp_path / "nothing.vast", *options)
    assert not list((tmp_path / "store").glob("execute"))


def test_fsspec_options_apply_only_to_s3(tmp_path):
    files, root = file_system(f"memory://{tmp_path.name}")
    assert isinstance(files, fsspec.get_filesystem_class("memory"))
    assert root.endswith(tmp_path.name)
