"""`run --pool`: what their options say without an API."""

from table import each_row
from typer.testing import CliRunner

from vastflow.flows.__main__ import app


@each_row("source", ["x.vast", "."])
@each_row("option", ["--shards", "--pool-wait"])
def test_options_of_a_pool_want_a_pool(source, option, tmp_path):
    result = CliRunner().invoke(app, ["run", str(tmp_path / source), option, "3"])
    assert result.exit_code == 2
    assert f"{option}: only with --pool, whose shards it is about" in result.stderr


def test_empty_name_is_no_pool(tmp_path):
    result = CliRunner().invoke(app, ["run", str(tmp_path / "x.vast"), "--pool", ""])
    assert (result.exit_code, "--pool: expected the name of a work pool, got an empty name" in result.stderr) == (
        2,
        True,
    )
