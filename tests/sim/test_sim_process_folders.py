"""A run's programs know its folders as `/config` and `/out` where bubblewrap mounts them there."""

import os
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.scenario import ProcessSetup
from vastflow.sim.scenario.programs import folders
from vastflow.sim.scenario.programs import run as run_module
from vastflow.sim.scenario.programs.folders import (
    below_config,
    copy_in,
    files_matching,
    handed_name,
    unmatched,
)
from vastflow.sim.scenario.programs.run import process_run
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.world import map_content, world_content

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def begun(tmp_path):
    """Begin runs of a campaign."""
    if not folders.can_mount():
        pytest.skip("bubblewrap is missing, or this machine forbids namespaces")
    (tmp_path / "campaign" / "files").mkdir(parents=True)

    def begin(files=(), **setup):
        for name, text in dict(files).items():
            path = tmp_path / "campaign" / name
            path.write_text(text)
            path.chmod(0o755)
        return process_run(ProcessSetup(files_matching(tmp_path / "campaign", ["**"]), **setup), where=tmp_path)

    return begin


def printed(run, *command):
    group = run.start(command)
    assert group.wait(120) == "", group.log.read()
    group.stop()
    return group.log.read().decode()


def test_pre_and_post_commands_write_only_to_out(begun):
    before = set(os.listdir("/"))
    files = {"files/pre.sh": "#!/bin/sh\n\ntouch /out/before", "files/post.sh": "#!/bin/sh\n\necho $* > /out/after"}
    with begun(files, pre_command="/config/files/pre.sh", post_command="/config/files/post.sh one") as run:
        record = run.close()
    assert record.post_command == ""
    assert set(record.outputs.files) == {"before", "after"}
    assert record.outputs.files["after"].startswith(b"one /")
    assert set(os.listdir("/")) == before


def test_programs_know_the_folders_by_their_names(begun, tmp_path):
    (tmp_path / "secret").write_text("outside")
    files = {
        "files/pre.sh": "export GOT=$1-$2",
        "files/given.txt": "given",
        "files/copy.py": "import shutil; shutil.copy('/config/files/given.txt', '/out/copied.txt')",
    }
    environment = {"GIVEN": "/config/files/given.txt"}
    with begun(files, environment=environment, pre_command="/config/files/pre.sh first 'the second'") as run:
        assert printed(run, "printenv", "GOT") == "first-the second\n"
        assert printed(run, "cat", "/config/files/given.txt") == "given"
        assert printed(run, "sh", "-c", "cat $GIVEN > /out/copy; cat /out/copy") == "given"
        printed(run, "sh", "-c", "echo second > files/given.txt")
        assert printed(run, "cat", "/config/files/given.txt", "/out/files/given.txt") == "givensecond\n"
        printed(run, sys.executable, "/config/files/copy.py")
        for path in ("/config/../secret", "/config/files/../../secret", "/out/../secret"):
            assert printed(run, "sh", "-c", f"cat {path} 2>/dev/null || true") == ""
        assert dict(run.close().outputs.files)["copied.txt"] == b"given"


def test_undeclared_run_file_is_named(begun):
    unmatched_file = r"no file that execution\.run_files matches lies there"
    with begun({"a.txt": "a"}) as run, pytest.raises(ScenarioError, match=unmatched_file):
        run.start(["/config/other.py"])
    missing = r"pre_command: there is no file '/config/other\.sh'"
    with pytest.raises(ScenarioError, match=missing), begun(pre_command="/config/other.sh"):
        pass


NEEDS = "a program that names /config or /out needs bwrap, .* Install it with `apt install bubblewrap`"


def test_run_that_names_a_folder_is_refused_without_bubblewrap(begun, monkeypatch):
    monkeypatch.setattr(run_module, "can_mount", lambda: False)
    with begun({"a.txt": "a"}) as run:
        assert printed(run, "cat", "a.txt") == "a"
        with pytest.raises(ScenarioError, match=NEEDS):
            run.start(["cat", "/config/a.txt"])
    with pytest.raises(ScenarioError, match=NEEDS), begun({"b.sh": "touch /out/b"}):
        pass


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="descriptors are read from /proc")
def test_run_leaves_no_descriptor_namespace_or_thread(begun):
    used = []
    for _ in range(3):
        with begun({"a.txt": "a"}) as run:
            printed(run, "cat", "/config/a.txt")
            with pytest.raises(ScenarioError, match="no program of this name in PATH"):
                run.start(["no-such-program", "/out"])
        used.append((len(os.listdir("/proc/self/fd")), threading.active_count()))
    assert used[-1] <= used[0]


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="signals are read from /proc")
def test_program_that_names_a_folder_is_started_like_any_other(begun):
    show = (
        "printf '%s|' \"$@\"; env | grep -e ^LC_ -e ^GIVEN; grep -e SigIgn -e SigBlk /proc/self/status; pwd; ulimit -a"
    )
    with begun() as run:
        run.environment = {"PATH": run.environment["PATH"], "GIVEN": "a b"}
        plain = printed(run, "sh", "-c", show, "sh", "", "a  b", "--", "*")
        assert printed(run, "sh", "-c", f"{show} # /out", "sh", "", "a  b", "--", "*") == plain


@each_row(
    ("name", "path"),
    [
        ("/config/files/pre.sh", "files/pre.sh"),
        ("files/pre.sh", "files/pre.sh"),
        ("./files//pre.sh", "files/pre.sh"),
        ("/config/../etc/passwd", None),
        ("/configuration/x", None),
        ("../x", None),
        ("/opt/ros/setup.bash", None),
    ],
)
def test_name_below_config_is_a_path_below_the_campaigns_folder(name, path):
    assert below_config(name) == path


PROBE = "from vastflow.sim.scenario.programs.folders import can_mount; print(can_mount())"


def test_can_mount_is_false_without_bubblewrap(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert not folders.can_mount.__wrapped__()


def test_machine_that_forbids_mounts_is_known():
    forbid = 'echo 0 > /proc/sys/user/max_mnt_namespaces; exec "$@"'
    command = ("unshare", "--user", "--map-root-user", "sh", "-c", forbid, "sh")
    if not shutil.which("unshare") or subprocess.run([*command, "true"], check=False, capture_output=True).returncode:
        pytest.skip("unshare can't do this here")
    assert subprocess.check_output([*command, sys.executable, "-c", PROBE]) == b"False\n"


def test_map_is_handed_to_programs_with_its_picture_unless_it_changed(tmp_path):
    folder = tmp_path / "maps"
    folder.mkdir()
    (folder / "hall.yml").write_text("{image: hall.pgm, resolution: 0.05, origin: [0, 0, 0]}")
    (folder / "hall.pgm").write_bytes(b"P5 2 2 255\n" + bytes([254, 0, 254, 254]))
    content = map_content(folder / "hall.yml")
    name = handed_name("map_file", content)
    assert name == f"map_file/{content.digest[:12]}.yaml"
    with process_run(ProcessSetup(), {"map_file": content}, where=tmp_path) as run:
        for place in (run.folders.config, run.folders.out):
            assert load_map(place / name).digest == content.digest
        assert run.close().outputs.files == {}
    (folder / "hall.pgm").write_bytes(b"P5 2 2 255\n" + bytes(4))
    changed = r"map_file: '.*hall\.yml' can't be copied: .*hall\.yml changed since the campaign was read. Run the campaign again"
    with (
        pytest.raises(ScenarioError, match=changed),
        process_run(ProcessSetup(), {"map_file": content}, where=tmp_path),
    ):
        pass


@pytest.fixture
def campaign(tmp_path):
    folder = tmp_path / "campaign"
    below = ("a.py", "b.yaml", "deep/er/c.py", ".git/config", "__pycache__/a.pyc")
    for name in ("run.py", "notes.txt", ".hidden", *(f"files/{name}" for name in below)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@each_row(
    ("pattern", "expected"),
    [
        ("run.py", ["run.py"]),
        ("*.py", ["files/a.py", "files/deep/er/c.py", "run.py"]),
        ("files/*.py", ["files/a.py"]),
        ("./files/*.py", ["files/a.py"]),
        ("files/**", ["files/a.py", "files/b.yaml", "files/deep/er/c.py"]),
        ("**", ["files/a.py", "files/b.yaml", "files/deep/er/c.py", "notes.txt", "run.py"]),
        ("**/[ab].*", ["files/a.py", "files/b.yaml"]),
        ("**/[!ab].py", ["files/deep/er/c.py"]),
        ("files/?.yaml", ["files/b.yaml"]),
        ("files/**/deep/**/c.*", ["files/deep/er/c.py"]),
        ("[z-a]", []),
        (".hidden", [".hidden"]),
        ("files/.git/*", ["files/.git/config"]),
        ("nothing/*", []),
    ],
)
def test_pattern_names_these_files(campaign, pattern, expected):
    assert [path for path, _ in files_matching(campaign, [pattern])] == expected


def test_files_come_once_in_the_order_of_their_paths_with_their_digests(campaign):
    found = files_matching(campaign, ["run.py", "*.py", "notes.txt"])
    assert [path for path, _ in found] == ["files/a.py", "files/deep/er/c.py", "notes.txt", "run.py"]
    assert all(content.digest == file_digest(campaign / path) for path, content in found)


def test_patterns_without_files_are_reported_and_folders_skipped(campaign):
    patterns = ["run.py", "rnu.py", "files/**"]
    assert unmatched(files_matching(campaign, patterns), patterns) == ("rnu.py",)
    found = files_matching(campaign, ["*.py"], lambda folder: folder.name == "deep")
    assert [path for path, _ in found] == ["files/a.py", "run.py"]


@each_row("pattern", ["/etc/passwd", "../secret", "files/../../secret", ""])
def test_pattern_that_leaves_the_folder_is_refused(campaign, pattern):
    with pytest.raises(ScenarioError, match=rf"expected .*, got run_files pattern '{re.escape(pattern)}'"):
        files_matching(campaign, [pattern])


def test_copies_hold_the_same_and_are_executable_where_their_originals_are(campaign, tmp_path):
    (campaign / "run.py").chmod(0o555)
    files = files_matching(campaign, ["*.py"])
    copy_in(files, tmp_path / "copy")
    copies = sorted(path for path in (tmp_path / "copy").rglob("*") if path.is_file())
    assert [path.relative_to(tmp_path / "copy").as_posix() for path in copies] == [path for path, _ in files]
    assert (tmp_path / "copy/run.py").stat().st_mode & 0o777 == 0o755


def test_file_that_changed_or_is_gone_is_not_copied(campaign, tmp_path):
    files = files_matching(campaign, ["run.py"])
    (campaign / "run.py").write_text("something else")
    with pytest.raises(ScenarioError, match=r"run\.py' changed since the campaign was read"):
        copy_in(files, tmp_path / "copy")
    (campaign / "run.py").unlink()
    with pytest.raises(ScenarioError, match=r"run\.py' can't be copied: no such file"):
        copy_in(files, tmp_path / "copy")


@pytest.mark.parametrize("uri", ["model://crate", "post.sdf"])
def test_program_gets_world_with_included_files(tmp_path, uri):
    crate = (
        "<sdf version='1.6'><model name='c'><link name='l'><collision name='c'><geometry><box><size>1 1 1</size></box>"
    )
    crate += "</geometry></collision></link></model></sdf>"
    for place in ("models/crate/model.sdf", "worlds/post.sdf"):
        (tmp_path / place).parent.mkdir(parents=True)
        (tmp_path / place).write_text(crate)
    file = tmp_path / "worlds" / "w.sdf"
    file.write_text(f"<sdf version='1.6'><world name='w'><include><uri>{uri}</uri></include></world></sdf>")
    content = world_content(file)
    with process_run(ProcessSetup(), {"world": content}, where=tmp_path) as run:
        for place in (run.folders.config, run.folders.out):
            assert world_content(place / handed_name("world", content)).digest == content.digest
        assert run.close().outputs.files == {}


def test_world_that_cannot_lie_in_one_folder_is_not_handed_to_programs(tmp_path):
    box = "<model name='c'><link name='l'><collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision></link></model>"
    (tmp_path / "worlds").mkdir()
    (tmp_path / "post.sdf").write_text(f"<sdf version='1.6'>{box}</sdf>")
    (tmp_path / "worlds" / "w.sdf").write_text(
        "<sdf version='1.6'><world name='w'><include><uri>../post.sdf</uri></include></world></sdf>"
    )
    content = world_content(tmp_path / "worlds" / "w.sdf")
    with (
        pytest.raises(ScenarioError, match=r"world: '.*w\.sdf' can't be copied: .*There is no file '\.\./post\.sdf'"),
        process_run(ProcessSetup(), {"world": content}, where=tmp_path),
    ):
        pass
