"""Containers of a campaign file: what is read, what is refused, and when `image` of RoboVAST is one."""

import re
from pathlib import Path

import pytest
from table import each_row

from vastflow.producers.campaign import load_campaign
from vastflow.sim.model.container import Container, Mount, container_of
from vastflow.sim.model.faults import FileError

SCENARIO = "import osc.helpers\nscenario go:\n    timeout(9s)\n    do serial:\n        run_process('true')\n"


@pytest.fixture
def loaded(tmp_path: Path):
    """Reads a campaign with this in its section `execution`."""

    def load(text: str, scenario: str = SCENARIO):
        (tmp_path / "go.osc").write_text(scenario.replace("'", '"'))
        (tmp_path / "a.vast").write_text(
            f"configuration: [{{name: a}}]\nexecution:\n  scenario_file: go.osc\n  {text}\n"
        )
        return load_campaign(tmp_path / "a.vast")

    return load


def test_container_of_a_file_is_what_a_run_starts(loaded):
    found = loaded(
        "containers: {main: {image: 'a:1'}, server: {image: 'b:2', command: 'python3 -u \"my server.py\"', env: {PORT: 80, FAST: true},"
        " mounts: [{source: data, target: /data}, {source: /srv, target: /srv, writable: true}], network: none, after: [main],"
        " resources: {cpu: 0.5, memory: 512Mi, processes: 9}, health: {port: 80, timeout: 5}}}\n  container_runtime: docker"
    )
    assert found.programs is not None and not found.notes
    assert found.programs.container_runtime == "docker"
    containers = {name: container_of(content) for name, content in found.programs.containers.items()}
    assert containers == {
        "main": Container(image="a:1"),
        "server": Container(
            image="b:2",
            command=("python3", "-u", "my server.py"),
            env={"PORT": "80", "FAST": "true"},
            mounts=(Mount("data", "/data"), Mount("/srv", "/srv", writable=True)),
            cpu=0.5,
            memory=512 << 20,
            processes=9,
            network="none",
            after=("main",),
            health={"port": 80, "timeout": 5.0},
        ),
    }


SECONDARY = (
    "secondary_containers: [nav, {sim: , resources: {cpu: 1}}, {name: third, image: 'c:3'}, {x: {image: 'd:4'}}]"
)


def test_image_and_secondary_containers_of_robovast_are_run_where_a_runtime_is_named(loaded):
    found = loaded(f"image: 'a:1'\n  {SECONDARY}\n  container_runtime: any")
    assert found.programs is not None and not found.notes
    images = {name: content["image"] for name, content in found.programs.containers.items()}
    assert images == {"main": "a:1", "nav": "a:1", "sim": "a:1", "third": "c:3", "x": "d:4"}
    assert found.programs.container_runtime == ""


def test_image_without_a_runtime_stays_a_note(loaded):
    found = loaded(f"image: 'a:1'\n  {SECONDARY}")
    assert found.programs is not None and found.programs.containers == {}
    assert [note.place.where for note in found.notes] == ["execution.image", "execution.secondary_containers"]


def test_containers_of_a_scenario_without_programs_have_no_effect(loaded):
    plain = SCENARIO.replace("run_process('true')", "wait elapsed(1s)")
    (note,) = loaded("containers: {main: {image: 'a:1'}}", plain).notes
    assert note.place.where == "execution.containers"
    assert "no program" in str(note)


@each_row(
    ("containers", "message"),
    [
        ("{a: {}}", "There is not one root file system. Give image or rootfs."),
        ("{a: {image: b, rootfs: /}}", "There is not one root file system. Give image or rootfs."),
        ("{a: {rootfs: etc, command: x}}", "expected an absolute path, got 'etc'"),
        ("{a: {rootfs: /}}", "Container 'a' has a rootfs and no command. Give it one."),
        ("{A: {image: b}}", "expected a name of lowercase letters, digits and hyphens, got 'A'"),
        (
            "{a: {image: b}, c: {rootfs: /, command: x}}",
            "Some containers have an image and some a rootfs. No runtime has both.",
        ),
        ("{a: {image: b, after: [c]}}", "Unknown container 'c' in after of 'a'. "),
        ("{a: {image: b, after: [c]}, c: {image: b, after: [a]}}", "'a' and 'c' wait for each other"),
        ("{a: {image: b, resources: {memory: 3GB}}}", "Unknown quantity '3GB'. Did you mean '3Gi'?"),
        ("{a: {image: b, resources: {cpu: 0}}}", "expected a number greater than 0, got 0"),
        ("{a: {image: b, health: {}}}", "There is not one check. Give log, port, or command."),
        ("{a: {image: b, health: {log: x, port: 1}}}", "There is not one check. Give log, port, or command."),
        ("{a: {image: b, mounts: [{source: ../x, target: /x}]}}", "one below the campaign file's folder, got '../x'"),
        ("{a: {image: b, mounts: [{source: x, target: x}]}}", "expected an absolute path, got 'x'"),
        ("{a: {image: b, network: host}}", "Unknown value 'host'. "),
        ('{a: {image: b, command: "x \'y"}}', "expected a command as a shell reads it (No closing quotation)"),
    ],
)
def test_wrong_container_is_a_fault_with_its_place(loaded, containers, message):
    with pytest.raises(FileError, match=r"a\.vast:4:\d+: execution\.containers.*" + re.escape(message)):
        loaded(f"containers: {containers}")
