"""Files that a campaign gives its programs: never copies that campaigns left beside it."""

import pytest

from vastflow.producers.campaign_file.scenario import run_files

LEFT = {
    "a campaign directory": ("campaign.vast", "metadata.json"),
    "an export": ("_config/campaign.vast",),
}


@pytest.fixture
def base(tmp_path):
    (tmp_path / "tools").mkdir()
    for name in ("drive.sh", "tools/drive.sh", "metadata.json"):
        (tmp_path / name).write_text(name)
    return tmp_path


def names(base, *patterns):
    return [path for path, _ in run_files(base, patterns)]


@pytest.mark.parametrize("marks", LEFT.values(), ids=LEFT)
@pytest.mark.parametrize("pattern", ["drive.sh", "**", "*/**/*.sh"])
def test_files_are_the_same_after_a_campaign_as_before(base, marks, pattern):
    before = names(base, pattern)
    left = base / "results" / "drive-2026-11-22-030000"
    for name in (*marks, "inputs/drive.sh", "inputs/tools/drive.sh"):
        (left / name).parent.mkdir(parents=True, exist_ok=True)
        (left / name).write_text(name)
    assert names(base, pattern) == before != []


def test_folder_of_ones_own_may_be_called_results(base):
    (base / "results").mkdir()
    (base / "results" / "expected.csv").write_text("1")
    assert names(base, "*.csv") == ["results/expected.csv"]


def test_campaign_file_beside_a_file_of_facts_is_still_the_campaigns_own_folder(base):
    (base / "campaign.vast").write_text("version: 1")
    assert "tools/drive.sh" in names(base, "drive.sh")
