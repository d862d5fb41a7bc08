"""The command `paper`."""

import json

from paper_page import main
from table import each_row
from typer import Typer
from typer.testing import CliRunner

script = Typer()
script.command()(main)


@each_row(
    ("metadata", "words"),
    [
        (None, "not a campaign directory"),
        ({"name": "quickstart"}, "campaign 'quickstart' is none of the paper's"),
        ({"name": "paper-safety"}, "damaged campaign directory"),
    ],
)
def test_paper_refuses_other_directories(tmp_path, metadata, words):
    if metadata:
        (tmp_path / "metadata.json").write_text(json.dumps(metadata))
    result = CliRunner().invoke(script, [str(tmp_path)])
    assert (result.exit_code, result.stdout) == (2, "")
    assert words in result.stderr and len(result.stderr.splitlines()) == 1
