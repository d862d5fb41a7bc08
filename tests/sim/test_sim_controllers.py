"""Controllers as plug-ins: found by name or file, checked by the conformance suite, driven at full speed."""

import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.sim.model.faults import FileError
from vastflow.sim.nav2.controllers import conformance
from vastflow.sim.nav2.controllers.conformance import check_controller, check_time, sample_situations
from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.nav2.parameter_files.plug_ins import CONTROLLER_PLUG_INS, find_controller, short_names
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.plug_ins import registry

PAGE = Path(__file__).parents[2] / "docs" / "write-a-controller.md"

HEAD = """
import math
import numpy as np
from vastflow.sim.kernels.streams import uniform
from vastflow.sim.kernels.plug_in import kernel
from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.model.parameter import parameter

"""
STAND = "compute_velocity = stand"


@pytest.fixture
def folder(tmp_path):
    """The files of the page."""
    for name in ("my_pursuit.py", "my_pursuit.yaml"):
        (text,) = re.findall(rf"^```\w+ {re.escape(name)}\n((?:.*\n)*?)^```$", PAGE.read_text(), re.MULTILINE)
        (tmp_path / name).write_text(text)
    return tmp_path


def own(tmp_path, body: str, members: str = STAND) -> Controller:
    """A controller whose kernel `stand` has this body; the class begins at a line of its own."""
    text = HEAD + "@kernel\ndef stand(q, memory, given):\n"
    text += textwrap.indent(textwrap.dedent(body), "    ")
    text += "\n\nclass Own(Controller):\n    gain: float = parameter(1.0, 0.0, 2.0)\n\n"
    text += textwrap.indent(textwrap.dedent(members), "    ")
    (tmp_path / "own.py").write_text(text)
    return find_controller("own.py:Own", tmp_path)()


def refused(controller, check=check_controller, *arguments) -> str:
    """Return the message with which a controller breaks its contract."""
    with pytest.raises(AssertionError, match=r"\w") as raised:
        check(controller, *arguments)
    return str(raised.value)


def line_of(tmp_path, text: str) -> str:
    """`file:line` of a line of the controller."""
    lines = (tmp_path / "own.py").read_text().splitlines()
    return f"{tmp_path / 'own.py'}:{next(k for k, line in enumerate(lines, 1) if text in line)}"


def test_documented_controller_keeps_contract(folder):
    check_controller(find_controller("my_pursuit.py:PurePursuit", folder)())


def test_documented_controller_drives_ten_meters_by_its_parameters(folder, over_a_floor):
    parameters = parameters_of({"nav2_params": nav2_file(folder / "my_pursuit.yaml")})
    found = over_a_floor(parameters)
    assert (type(parameters.controller).__name__, parameters.controller.desired_linear_vel) == ("PurePursuit", 0.45)
    assert found.run.outcome == "succeeded"
    assert found.run.distance_m == pytest.approx(10.0, abs=0.4)
    commands = found.columns["command_speed_mmps"]
    assert np.median(commands[commands > 0]) == 450  # MPPI, the default, drives at 500
    assert not np.array_equal(commands[:50], over_a_floor(NavParameters()).columns["command_speed_mmps"][:50])


@each_row("name", ["dwb", "mppi", "rpp"])
def test_shipped_controller_keeps_contract_and_has_the_parameters_that_were_read(name):
    kind = find_controller(short_names()[name])
    check_controller(kind())
    parameters = parameters_of({"controller": name}).controller
    assert type(with_kernels(parameters)) is kind
    assert dict(with_kernels(parameters)) == dict(parameters)


SHARED = f"_SHARED: object = np.zeros(1)\n{STAND}\ndef memory(self, setting): return (self._SHARED,)\n"
AGAIN = "command the same again. It keeps something outside of its memory"
RAISING = "if given.plan.shape[0] < 3:\n    raise ValueError('no path')\nreturn True, 0.0, 0.0"


@each_row(
    ("body", "members", "message"),
    [
        ("return True, np.zeros(3 + given.plan.shape[0])[2], 0.0", STAND, "allocate nothing in a call, got 1 "),
        ("return True, math.nan * q.gain, 0.0", STAND, "give a finite command, or none, in 'a straight path'"),
        ("return True, 0.3 * q.gain, 0.0", STAND, "not drive into a wall across the path: v = 0.30 m/s"),
        (
            "given.window.costs[0, 0] = 7\nreturn True, 0.0, 0.0",
            STAND,
            "not change what it is given in 'a straight path'",
        ),
        ("memory[0][0] += 0.01\nreturn True, memory[0][0], 0.0", SHARED, AGAIN),
    ],
)
def test_conformance_rejects_controller_that_breaks_contract(tmp_path, body, members, message):
    assert refused(own(tmp_path, body, members)).startswith(f"{line_of(tmp_path, '@kernel')}: Own must {message}")


def test_conformance_rejects_controller_that_raises(tmp_path):
    said = refused(own(tmp_path, RAISING))
    assert said.startswith(
        f"{line_of(tmp_path, 'raise')}: Own.compute_velocity must not raise, and raised ValueError: no"
    )


def test_conformance_rejects_slow_controller(tmp_path):
    body = "x = 0.0\nfor k in range(3_000_000):\n    x = math.sin(x + k)\nreturn True, 0.0 * x, 0.0\n"
    said = refused(own(tmp_path, body), check_time, sample_situations()[:1])
    assert said.startswith(line_of(tmp_path, "@kernel"))
    assert re.search(r"Own must take at most 2000 µs a call, took \d+ in 'a straight path'", said)


def test_controller_may_draw_random_numbers_of_its_stream(tmp_path):
    members = f"{STAND}\ndef memory(self, setting): return (setting.stream,)\n"
    check_controller(own(tmp_path, "return True, 0.0, uniform(memory[0])\n", members))


ZERO = "True, 0.0, 0.0"
INNER = "from vastflow.sim.kernels.numeric import inner\ncompute_velocity = inner(stand.py_func)"


@each_row(
    ("result", "members", "message"),
    [
        ("0.0, 0.0", STAND, r"Own.compute_velocity must return \(valid, v, ω\).*got UniTuple\(float64 x 2\)"),
        ("True, q.speed, 0.0", STAND, "Own.compute_velocity can't be compiled: .*speed"),
        (ZERO, "compute_velocity = math.hypot", "Own.compute_velocity is not compiled. Decorate it with @kernel"),
        (
            ZERO,
            INNER,
            "Own.compute_velocity is compiled for its callers alone. Decorate it with @kernel",
        ),
        (ZERO, f"{STAND}\ndef memory(self, setting): return (1.0,)", "memory.0 of Own is float. Expected numpy arrays"),
    ],
)
def test_conformance_rejects_other_objects(tmp_path, result, members, message):
    said = refused(own(tmp_path, f"return {result}\n", members), conformance.check_kernels, ())
    assert re.search(message, said)
    assert re.match(r"\S+own\.py:\d+: |math: ", said)


def faults(tmp_path, plugin: str, more: str = "") -> str:
    text = "controller_server:\n  ros__parameters:\n    controller_plugins: [FollowPath]\n    FollowPath:\n"
    (tmp_path / "nav2.yaml").write_text(f"{text}      plugin: {plugin}\n{textwrap.indent(more, '      ')}")
    with pytest.raises(FileError, match="FollowPath") as raised:
        nav2_file(tmp_path / "nav2.yaml")
    return str(raised.value)


def test_parameters_of_a_plug_in_are_checked_at_their_lines(folder):
    values = "lookahead_dist: 9.0\nlookahed: 1\nmax_angular_vel: fast\n"
    at, name = f"{folder}/nav2.yaml", "controller_server.ros__parameters.FollowPath"
    assert faults(folder, "my_pursuit.py:PurePursuit", values).splitlines() == [
        f"{at}:6:23: {name}.lookahead_dist: expected a number in [0.1, 3], got 9.0",
        f"{at}:7:17: {name}.lookahed: PurePursuit has no parameter 'lookahed'. Did you mean 'lookahead_dist'?",
        f"{at}:8:24: {name}.max_angular_vel: expected a number, got 'fast'",
    ]


@each_row(
    ("plugin", "message"),
    [
        (
            "nav2_mppi_controler::MPPIController",
            "Did you mean 'nav2_mppi_controller::MPPIController'?",
        ),
        ("none.py:Own", "none.py'. Name file.py:Class for one of your own, relative to the parameter file"),
        ("own.py:Owl", "has no class 'Owl'. Did you mean 'Own'?"),
        ("own.py:math", "'own.py:math' is not a controller. Expected a subclass of"),
        ("broken.py:Own", "broken.py:Own' can't be imported: ZeroDivisionError"),
        ("typo.py:Own", "typo.py', line 1 can't be imported: SyntaxError"),
    ],
)
def test_parameter_file_reports_unavailable_plug_in_at_its_line(tmp_path, plugin, message):
    own(tmp_path, "return True, 0.0, 0.0\n")
    (tmp_path / "broken.py").write_text("1 / 0\n")
    (tmp_path / "typo.py").write_text("class Own(\n")
    said = faults(tmp_path, plugin)
    assert said.startswith(f"{tmp_path}/nav2.yaml:5:15: controller_server.ros__parameters.FollowPath.plugin: ")
    assert message in said


def test_parameters_and_digest_belong_to_plug_in_as_read(folder):
    content, file = nav2_file(folder / "my_pursuit.yaml"), folder / "my_pursuit.py"
    (folder / "other.py").write_text("")
    assert content == nav2_file(folder / "my_pursuit.yaml")
    text = file.read_text()
    file.write_text(text.replace("desired_linear_vel: float = parameter(0.4", "later: float = parameter(0.4"))
    assert "later" not in type(parameters_of({"nav2_params": content}).controller).model_fields
    file.write_text(text.replace("2.0 * v", "1.9 * v"))
    assert content.digest != nav2_file(folder / "my_pursuit.yaml").digest


def test_key_controller_takes_a_plug_in_that_the_file_lists(folder):
    (folder / "both.yaml").write_text(
        "controller_server:\n  ros__parameters:\n    controller_plugins: [FollowPath, Own]\n"
        "    FollowPath: {plugin: 'nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController'}\n"
        "    Own: {plugin: 'my_pursuit.py:PurePursuit', lookahead_dist: 0.9}\n"
    )
    system = {"nav2_params": nav2_file(folder / "both.yaml")}
    assert type(parameters_of(system).controller).__name__ == "RppParameters"
    chosen = parameters_of({**system, "controller": "my_pursuit.py:PurePursuit"}).controller
    assert (type(chosen).__name__, chosen.lookahead_dist) == ("PurePursuit", 0.9)
    with pytest.raises(FileError, match=r"Did you mean 'my_pursuit.py:PurePursuit'\?"):
        parameters_of({**system, "controller": "my_pursuit.py:PurePursit"})


def test_registry_asks_to_reinstall_when_metadata_is_outdated(monkeypatch):
    monkeypatch.setattr(registry, "known_plug_ins", lambda group: {})
    with pytest.raises(
        RuntimeError, match=r"its metadata is older than its source\. Install it again: pip install -e \."
    ):
        _ = replace(CONTROLLER_PLUG_INS).known


def test_parameters_of_built_in_controllers_are_read_without_numba_and_scipy():
    script = (
        "import sys; from vastflow.sim.nav2.parameter_files.chosen import parameters_of; "
        "print([type(parameters_of({'controller': name}).controller).__name__ for name in ('dwb', 'mppi', 'rpp')]); "
        "print(*{'numba', 'scipy', 'llvmlite'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=240, check=True)
    assert done.stdout.splitlines() == ["['DwbParameters', 'MppiParameters', 'RppParameters']", ""]
