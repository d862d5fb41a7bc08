"""The command `ui`: listed without its libraries, and refused in a sentence."""

import socket
import subprocess
import sys

from command_line import called, refused
from typer.main import get_command

from vastflow.flows.cli.__main__ import app


def test_ui_is_listed_without_importing_a_server():
    code = "import sys; sys.argv = ['vastflow', '--help']\nfrom vastflow.flows.cli.__main__ import main\n"
    code += "try:\n    main()\nfinally:\n    print({'starlette', 'uvicorn', 'numpy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=240, check=False)
    *listed, imported = done.stdout.strip().splitlines()
    assert listed[-1].split(maxsplit=1) == ["ui", "Explore campaigns in the browser."]
    assert imported == "set()"


def test_ui_shows_its_options():
    assert {"--port", "--no-browser"} <= {*called("ui", "--help").stdout.split()}


def test_ui_is_loaded_on_request():
    command = get_command(app)
    assert "ui" not in command.commands
    assert command.get_command(None, "ui").name == "ui"
    assert command.get_command(None, "nothing") is None


def test_ui_refuses_a_missing_folder(tmp_path):
    assert "expected a folder with campaign directories" in refused("ui", tmp_path / "nothing", "--no-browser")


def test_ui_refuses_a_taken_port(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert "Choose a free port, or 0" in refused("ui", tmp_path, "--no-browser", "--port", port)
