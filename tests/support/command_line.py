"""`vastflow` called in this process."""

import re
from pathlib import Path

from typer.main import get_command
from typer.testing import CliRunner

from vastflow.flows.cli.__main__ import app

DOCS = Path(__file__).parents[2] / "docs"


def called(*arguments, **environment):
    return CliRunner(env=environment).invoke(app, [*map(str, arguments)], terminal_width=160)


def refused(*arguments):
    """Return the only line of a call that ends with exit code 2, without an excerpt."""
    result = called(*arguments)
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    (line,) = (each for each in result.stderr.splitlines() if not each.startswith("  "))
    assert "Traceback" not in line
    return line


def options_of(*names):
    """Return the names of a command's options, without --help."""
    command = get_command(app)
    for name in names:
        command = command.commands[name]
    return {option for each in command.params for option in each.opts if option.startswith("--")} - {"--help"}


def options_on(page):
    """Return the options in the first column of a page's tables."""
    rows = re.findall(r"^\| (`--[^|]*)\|", (DOCS / page).read_text(), re.MULTILINE)
    return {option for row in rows for option in re.findall(r"--[a-z]+(?:-[a-z]+)*", row)}
