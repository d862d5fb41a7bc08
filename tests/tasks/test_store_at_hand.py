"""Campaign directories at an address: shown and exported from there, and a sentence where that can't be."""

import re

import pytest
from bench_pipeline import SCENARIO, campaign_text
from command_line import called
from table import each_row

from vastflow.flows.results.address import WITHOUT_RUNS, at_hand, meant_address
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.tasks.store.remote_files import file_system


def files(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def kept(tmp_path, shared_s3, s3_variables):
    """Puts files at an address of a real S3 server."""
    s3_variables(shared_s3)

    def keep(address, **contents):
        system, root = file_system(address)
        for name, content in contents.items():
            system.pipe_file(f"{root}/{name.replace('__', '/').replace('_', '.')}", content)
        return address

    return keep


@pytest.mark.timeout(900)
def test_campaign_on_s3_is_shown_and_exported_like_a_folder(
    tmp_path, shared_s3, s3_variables, monkeypatch, prefect_home
):
    s3_variables(shared_s3)
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(tmp_path / "prefect")))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    (tmp_path / "nothing.vast").write_text(campaign_text(1, 2, edited=0))
    (tmp_path / "nothing.osc").write_text(SCENARIO)
    run = called("run", tmp_path / "nothing.vast", "--results", "s3://bucket/shown", "--store", tmp_path / "store")
    assert run.exit_code == 0, run.output
    (address,) = re.findall(r"uploaded to (\S+) ", run.stdout)
    (folder,) = (tmp_path / "store" / "results").iterdir()

    here, there = called("show", folder), called("show", f"{address}/")
    assert (here.exit_code, there.exit_code) == (0, 0), there.output
    assert here.stdout.replace(str(folder), address) == there.stdout
    assert f"report: {address}/report.html" in there.stdout

    here, there = called("export", folder, tmp_path / "here"), called("export", address, tmp_path / "there")
    assert (here.exit_code, there.exit_code) == (0, 0), there.output
    assert files(tmp_path / "here") == files(tmp_path / "there") != {}


def test_excluded_folders_are_not_fetched(kept):
    address = kept("s3://bucket/one", metadata_json=b"{}", recordings__a=b"1", logs__b=b"2", inputs__recordings=b"3")
    with at_hand(address, ("recordings",)) as folder:
        assert set(files(folder)) == {"metadata.json", "logs/b", "inputs/recordings"}
    assert not folder.exists()
    with at_hand(address, WITHOUT_RUNS) as folder:
        assert set(files(folder)) == {"metadata.json"}


def test_snapshot_of_folder_is_folder(tmp_path):
    with at_hand(str(tmp_path)) as folder:
        assert folder == tmp_path


@pytest.mark.parametrize("command", ["show", "export"])
def test_address_of_several_campaigns_suggests_one(kept, tmp_path, command):
    kept("s3://bucket/some/nothing-1", metadata_json=b"{}")
    kept("s3://bucket/some/nothing-2", metadata_json=b"{}")
    result = called(command, "s3://bucket/some", *[tmp_path / "out"] * (command == "export"))
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == (
        "s3://bucket/some: It holds 2 campaign directories. Name one of them, such as s3://bucket/some/nothing-2\n"
    )


def test_empty_address_is_reported_in_one_sentence(kept):
    kept("s3://bucket/other", report_html=b"<html>")
    with (
        pytest.raises(
            UnusableDirectory, match=r"s3://bucket/other: This is not a campaign directory, as it has no metadata\.json"
        ),
        at_hand("s3://bucket/other"),
    ):
        pass


@each_row(
    "command",
    [["plan", "ADDRESS"], ["run", "ADDRESS"], ["compare", "ADDRESS", "."]],
)
def test_commands_refuse_addresses_and_name_alternatives(command):
    address = "s3://bucket/shown/nothing-1"
    result = called(*(word.replace("ADDRESS", address) for word in command))
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == (
        f"{address}: Only `vastflow show` and `vastflow export` read an address. Copy it into a folder first.\n"
    )


def test_existing_path_is_read_as_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ab:" / "c").mkdir(parents=True)
    from pathlib import Path

    assert meant_address(Path("ab:/c")) is None
    assert meant_address(Path("s3://bucket/c")) == "s3://bucket/c"
    assert meant_address(Path("results/c")) is None
