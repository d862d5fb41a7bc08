"""Worlds that a reader beside the campaign file makes."""

import re
import shutil

import pytest
from command_line import refused
from table import each_row

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.oracles.results.executed import KeptFiles
from vastflow.sim.model.faults import FileError
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.world import read_world, world_content
from vastflow.tasks.engine.bundle import Packer
from vastflow.tasks.store.store import open_store

READER = """\
from vastflow.plugins import Body, Disc, Pose

class Posts:
    files = ["radius.txt"]

    @staticmethod
    def read(path):
        {body}
"""
POSTS = (
    "return [Body(f'p{x}', Disc(float(path.with_name('radius.txt').read_text())), Pose(x, 1.0, 0.0)) for x in range(3)]"
)


@pytest.fixture
def campaign(small_room, tmp_path, monkeypatch):
    """A function that writes the small room's campaign with a world of its own reader."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    home = small_room.parent
    (home / "radius.txt").write_text("0.125")
    text = small_room.read_text()
    at = text.index("map_file:")
    first, rest = text[at:].split("\n", 1)
    indent = text[text.rindex("\n", 0, at) + 1 : at]

    def write(body=POSTS, name="own.py:Posts"):
        (home / "own.py").write_text(READER.format(body=body))
        small_room.write_text(f"{text[:at]}{first}\n{indent}world: {name}\n{rest}")
        return small_room

    return write


def world_of_family(file):
    campaign, oracles = read_campaign(file)
    return campaign.families[0].values["world"], inputs_of(campaign, oracles)


def test_bodies_of_own_reader_are_world_by_their_content(campaign, tmp_path):
    found, _ = world_of_family(campaign())
    bodies = read_world(found).bodies
    assert [(body.name, body.shape.radius_m, body.pose.x_m) for body in bodies] == [
        (f"p{x}", 0.125, x) for x in range(3)
    ]
    again, _ = world_of_family(campaign(f"# a comment\n        {POSTS}"))
    other, _ = world_of_family(campaign(POSTS.replace("range(3)", "range(4)")))
    assert again.digest == found.digest != other.digest
    (tmp_path / "c.csv").write_text("".join(f"{x},1,0.125\n" for x in range(3)))
    assert world_content(tmp_path / "c.csv").digest == found.digest


def test_file_of_own_reader_is_kept_with_it(campaign):
    file = campaign()
    found, inputs = world_of_family(file)
    assert inputs.files["radius.txt"] == b"0.125"
    (file.parent / "radius.txt").write_text("0.25")
    other, _ = world_of_family(file)
    assert other.digest != found.digest


def test_undeclared_file_of_own_reader_is_named(campaign):
    file = campaign()
    (file.parent / "own.py").write_text(READER.format(body=POSTS).replace("files =", "others ="))
    with pytest.raises(FileError, match=r"Posts: own\.py reads 'radius\.txt', which it does not declare.* files = "):
        read_campaign(file)


def test_world_of_own_reader_is_kept_and_sent_without_running_it(campaign, tmp_path):
    found, inputs = world_of_family(campaign())
    directory = tmp_path / "results"
    directory.mkdir()
    inputs.write(directory)
    assert {"own.py", "room.yaml"} < {*inputs.files}
    bundle = Packer(store := open_store(tmp_path / "store")).packed([found])
    shutil.rmtree(tmp_path / "cache")
    (directory / "inputs" / "own.py").write_text("raise SystemExit")
    for content in (KeptFiles(directory).content(found.digest), *bundle.opened(store)):
        read_world.cache_clear()
        assert len(read_world(content).bodies) == 3


@each_row(
    "body, name, message",
    [
        (POSTS, "own.py:Post", r"own\.py: Post: AttributeError: .*no attribute 'Post'"),
        (POSTS, "gone.py:Posts", r"gone\.py"),
        ("return 1 / 0", "own.py:Posts", r"own\.py: Posts: ZeroDivisionError: division by zero"),
        ("return [1]", "own.py:Posts", r"own\.py: Posts: PydanticSerialization"),
        ("return []", "own.py:Posts", "no body that a robot could meet"),
        ("return [Body('b', Disc(float('nan')), Pose(0.0, 0.0, 0.0))]", "own.py:Posts", "expected"),
        (
            "return [Body('b', Disc(1.0), Pose(1e9, 0.0, 0.0))]",
            "own.py:Posts",
            "b: expected an area within 20000 m of the origin",
        ),
        (
            "return [Body('b', Disc(-0.5), Pose(5.0, 4.0, 0.0))]",
            "own.py:Posts",
            r"own\.py: Posts: b: expected an area .* sizes above 0",
        ),
        (
            "return [Body('b', Disc(0.5), Pose(5.0, 4.0, 0.0), 0.4, 1.0)]",
            "own.py:Posts",
            r"own\.py: Posts: The world has no body that a robot could meet",
        ),
        ("raise SystemExit(3)", "own.py:Posts", r"own\.py: Posts: PlugInExit"),
    ],
)
def test_unusable_reader_is_one_sentence_at_its_line(campaign, body, name, message):
    said = refused("validate", campaign(body, name))
    assert re.search(rf"room\.vast:\d+:\d+: configuration\[0\].*{message}", said), said
    assert "Traceback" not in said


POSED = '"pose": {"x_m": 1, "y_m": 1, "yaw_rad": 0}'


@each_row(
    "shape",
    [
        f'{{"radius_m": -0.5}}, {POSED}',
        f'{{"length_m": -0.5, "width_m": 0.5}}, {POSED}',
        f'{{"length_m": -0.5, "width_m": -0.5}}, {POSED}',
        f'{{"vertices_m": [[0, 0], [2, 2], [2, 0], [0, 1]]}}, {POSED}',
        f'{{"vertices_m": [[0, 0], [2, 2]]}}, {POSED}',
        f'{{"vertices_m": []}}, {POSED}',
        f'{{"vertices_m": [[0, 0], [1, 1], [2, 2]]}}, {POSED}',
        '{"radius_m": 0.5}, "pose": {"x_m": 1, "y_m": 1, "yaw_rad": NaN}',
        '{"length_m": 0.5, "width_m": 0.5}, "pose": {"x_m": 1, "y_m": 1, "yaw_rad": NaN}',
        '{"radius_m": 0.5}, "pose": {"x_m": NaN, "y_m": 1, "yaw_rad": 0}',
        f'{{"radius_m": 0.5}}, {POSED}, "bottom_m": NaN',
    ],
)
def test_body_without_valid_area_is_one_sentence(tmp_path, shape):
    (tmp_path / "w.bodies.json").write_text(f'[{{"name": "b", "shape": {shape}}}]')
    with pytest.raises(WorldError, match=r"w\.bodies\.json: b: expected an area .*, got .* at Pose\(.* m$"):
        world_content(tmp_path / "w.bodies.json")


def test_bodies_off_heights_of_robot_are_left_out(tmp_path):
    heights = {"mat": (0.0, 0.02), "sill": (0.0, 0.021), "table": (0.39, 0.8), "lamp": (0.4, 0.8)}
    rows = [
        f'{{"name": "{name}", "shape": {{"radius_m": 0.5}}, {POSED}, "bottom_m": {low}, "top_m": {high}}}'
        for name, (low, high) in heights.items()
    ]
    (tmp_path / "w.bodies.json").write_text(f"[{','.join(rows)}]")
    content = world_content(tmp_path / "w.bodies.json")
    assert [body.name for body in read_world(content).bodies] == ["sill", "table"]


@each_row(
    "content, message",
    [
        ("{}", "expected bodies"),
        ("[" * 100_000, "expected bodies"),
        ('[{"name": "b", "shape": {"radius_m": "x"}, "pose": {"x_m": 0, "y_m": 0, "yaw_rad": 0}}]', "expected bodies"),
        ('[{"name": "b", "shape": {"radius_m": 1e308}, "pose": {"x_m": 0, "y_m": 0, "yaw_rad": 0}}]', "expected an area within"),
        ('[{"name": "b", "shape": {"radius_m": 1}, "pose": {"x_m": 0, "y_m": 0, "yaw_rad": 0}, "bottom_m": 9, "top_m": 1}]', "heights in order"),
    ],
)  # fmt: skip
def test_unusable_list_of_bodies_is_one_sentence(tmp_path, content, message):
    (tmp_path / "w.bodies.json").write_text(content)
    with pytest.raises(WorldError, match=message) as error:
        world_content(tmp_path / "w.bodies.json")
    assert "w.bodies.json" in str(error.value) and "\n" not in str(error.value)
