"""The commands `dev paper` and `dev bench`, which run scripts of the repository."""

import json
import os
import sys

import pytest
from bench_show import shown
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
from vastflow.flows.cli import development

COMMANDS = {
    ("paper", "here", "-there"): ("paper_page", "--", "here", "-there"),
    ("bench", "sim"): ("bench_simulator", "--controller=mppi"),
    ("bench", "sim", "--controller", "dwb", "--profile", "--json"): (
        "bench_simulator",
        "--controller=dwb",
        "--profile",
        "--json",
    ),
    ("bench", "pipeline"): ("bench_pipeline", "--configurations=5480", "--runs=20"),
    ("bench", "pipeline", "--configurations", "6", "--runs", "2", "--json"): (
        "bench_pipeline",
        "--configurations=6",
        "--runs=2",
        "--json",
    ),
}


class Became(Exception):
    """What this process would have become."""


def called(*arguments):
    return CliRunner().invoke(app, ["dev", *arguments])


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_command_becomes_its_script(command, monkeypatch):
    def execv(program, words):
        raise Became(program, words)

    monkeypatch.setattr(os, "execv", execv)
    name, *arguments = COMMANDS[command]
    words = ["paper", "--", *command[1:]] if command[0] == "paper" else command
    script = development.PROOFS / f"{name}.py"
    assert called(*words).exception.args == (sys.executable, [sys.executable, str(script), *arguments])
    assert script.is_file()


@pytest.mark.parametrize("command", [("paper", "results"), ("bench", "sim"), ("bench", "pipeline")], ids=" ".join)
def test_without_the_repository_a_command_says_where_its_script_is(command, tmp_path, monkeypatch):
    monkeypatch.setattr(development, "PROOFS", tmp_path)
    result = called(*command)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "which only a clone of vastflow's repository has" in result.stderr


def test_what_was_measured_is_json_or_a_table():
    found = {"controller": "mppi", "x_real_time": 250.123, "map": {"seed": 20}, "profile": {"lidar": 0.3}}
    assert json.loads(shown(found, as_json=True)) == found
    assert shown(found, as_json=False) == (
        "controller     mppi\nx_real_time    250.1\nmap.seed       20\nprofile.lidar  0.3"
    )
