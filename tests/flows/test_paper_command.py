"""The command `paper`."""

import json

from paper_page import main
from typer import Typer
from typer.testing import CliRunner

script = Typer()
script.command()(main)


def called(*arguments):
    return CliRunner().invoke(script, [*map(str, arguments)])


def test_what_is_no_campaign_directory_is_said(tmp_path):
    result = called(tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "not a campaign directory" in result.stderr


def test_another_campaign_is_refused(tmp_path):
    (tmp_path / "metadata.json").write_text(json.dumps({"name": "quickstart"}))
    result = called(tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "campaign 'quickstart' is none of the paper's" in result.stderr


def test_damaged_directory_is_said_in_one_line(tmp_path):
    (tmp_path / "metadata.json").write_text(json.dumps({"name": "paper-safety"}))
    result = called(tmp_path)
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)
    assert "damaged campaign directory" in result.stderr
