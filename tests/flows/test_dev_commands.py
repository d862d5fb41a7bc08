"""The commands `dev paper` and `dev bench`, which run scripts of the repository."""

import json
import os
import sys

from bench_show import shown
from command_line import called, refused
from paper_page import main
from table import each_row
from typer import Typer
from typer.testing import CliRunner

from vastflow.flows.cli import development


class Became(Exception):
    """The program that this process would have become."""


@each_row(
    ("command", "script"),
    [
        ("paper here there", "paper_page.py here there"),
        ("bench sim --controller dwb --profile --json", "bench_simulator.py --controller dwb --profile --json"),
        ("bench pipeline --configurations 6 --help", "bench_pipeline.py --configurations 6 --help"),
    ],
)
def test_dev_command_runs_its_script(command, script, monkeypatch, tmp_path):
    def execv(program, words):
        raise Became(program, words)

    name, *arguments = script.split()
    with monkeypatch.context() as patch:
        patch.setattr(os, "execv", execv)
        program, words = called("dev", *command.split()).exception.args
    assert (program, words) == (sys.executable, [sys.executable, str(development.PROOFS / name), *arguments])
    assert (development.PROOFS / name).is_file()
    with monkeypatch.context() as patch:
        patch.setattr(development, "PROOFS", tmp_path)
        assert "expected a clone of vastflow's repository" in refused("dev", *command.split())


def test_bench_shows_measurements_as_json_or_table():
    found = {"controller": "mppi", "x_real_time": 250.123, "map": {"seed": 20}, "profile": {"lidar": 0.3}}
    assert json.loads(shown(found, as_json=True)) == found
    assert shown(found, as_json=False) == (
        "controller       mppi\nx_real_time     250.1\nmap.seed           20\nprofile.lidar     0.3"
    )


def test_paper_refuses_other_directory(tmp_path):
    (tmp_path / "metadata.json").write_text(json.dumps({"name": "quickstart"}))
    script = Typer()
    script.command()(main)
    result = CliRunner().invoke(script, [str(tmp_path)])
    assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1)
    assert "campaign 'quickstart' is none of the paper's" in result.stderr
