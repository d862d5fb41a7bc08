"""An edit of a large campaign: what is known is taken from the store, and no byte tells."""

import hashlib
import re
from pathlib import Path

import pytest
from bench_pipeline import SCENARIO, campaign_text

from vastflow.flows import run_campaign

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

OF_A_CALL = {"metadata.json", "logs", ".files.json"}


@pytest.fixture
def file(tmp_path, monkeypatch) -> Path:
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    (tmp_path / "nothing.osc").write_text(SCENARIO)
    return tmp_path / "nothing.vast"


def contents(directory: Path) -> dict[str, str]:
    """Digests of all files that follow from the campaign alone, the report without what it says of its call."""
    found = {}
    for file in sorted(directory.rglob("*")):
        if file.is_file() and file.relative_to(directory).parts[0] not in OF_A_CALL:
            content = file.read_bytes()
            if file.name == "report.html":
                for mark in (b"when", b"work"):
                    content = re.sub(b"(?s)<!-- %b -->.*?<!-- /%b -->" % (mark, mark), b"", content)
            found[file.relative_to(directory).as_posix()] = hashlib.sha256(content).hexdigest()
    return found


def test_edited_campaign_has_the_bytes_of_a_run_from_nothing(file, tmp_path):
    def run(store, results):
        return run_campaign(file, store=str(tmp_path / store), results=str(tmp_path / results), workers=1)

    file.write_text(campaign_text(24, 2, edited=0))
    assert run("store", "first").summary.executed == 48
    file.write_text(campaign_text(24, 2, edited=1))
    edited = run("store", "edited")
    assert (edited.summary.executed, edited.summary.reused) == (2, 46)
    assert contents(edited.directory) == contents(run("other", "nothing").directory)
