"""Coverage: in the plan of a campaign file and of a campaign directory, in words and as JSON."""

import json

import pytest
from command_line import called, refused
from table import each_row

from vastflow.flows.plan.text import share_text
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate

VARIED = """\
      - ParameterVariationList:
          name: laserscan_random_drop_percentage
          values: [0.0, 0.5, 0.5]
      - PathVariationRandom:
          path_length: 200.0
          path_length_tolerance: 0.5
          robot_diameter: 0.5
          seed: 3
          goal_poses: "@goal_pose"
    constraints:
      - see_enough: laserscan_gaussian_noise_std_deviation < 0.01 or laserscan_random_drop_percentage < 0.4
  - name: still
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}
    variations:
      - ParameterVariationList: {name: laserscan_gaussian_noise_std_deviation, values: [0.0, 0.0, 0.02]}
      - ParameterVariationList: {name: laserscan_random_drop_percentage, values: [0.0, 0.5]}
"""


@pytest.fixture
def campaign_file(small_room, tmp_path, monkeypatch):
    """Two families: one of which constraints exclude a part and no path can be built, one with duplicates."""
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    text = small_room.read_text().replace("execution:\n", VARIED + "execution:\n")
    small_room.write_text(text.replace("      - goal_pose: {x: 3.0, y: 1.0, yaw: 0.0}\n", "", 1))
    return small_room


@pytest.fixture
def expected(campaign_file):
    return instantiate(load_campaign(campaign_file)).coverage


@pytest.fixture
def directory(expected, tmp_path):
    folder = tmp_path / "results" / "small-room-2026-11-21-120000"
    folder.mkdir(parents=True)
    (folder / "metadata.json").write_text("{}")
    (folder / "coverage.json").write_text(json.dumps(expected))
    return folder


def covered(path, *options):
    """Return the result of `plan` for a campaign file, or of `show` for a directory."""
    return called("plan" if path.is_file() else "show", path, "--coverage", *options)


def row_of(text, *begin):
    """The words of the first line that begins with `begin`."""
    return next(words for words in map(str.split, text.splitlines()) if tuple(words[: len(begin)]) == begin)


def test_plan_and_show_print_equal_coverage(campaign_file, directory, expected):
    printed = covered(campaign_file, "--json").stdout
    assert json.loads(printed)["coverage"] == expected and len(printed.splitlines()) == 1
    assert json.loads(covered(directory, "--json").stdout) == expected
    assert covered(campaign_file).stdout.startswith(covered(directory).stdout)


def test_coverage_counts_fates_of_requested_configurations(directory):
    printed = covered(directory).stdout
    assert row_of(printed, "room")[1:6] == ["6", "2", "4", "0", "0"]
    assert row_of(printed, "still")[1:6] == ["6", "0", "0", "2", "4"]
    assert row_of(printed, "all")[1:6] == ["12", "2", "4", "2", "4"]
    assert row_of(printed, "2", "×", "room") == ["2", "×", "room", "see_enough"]
    assert row_of(printed, "4", "×", "room")[3] == "PathVariationRandom"
    assert "200 m" in printed
    assert row_of(printed, "still", "system")[2:] == [
        *("4", "6", "6", "6", "100.0", "%"),
        *("laserscan_gaussian_noise_std_deviation,", "laserscan_random_drop_percentage"),
    ]
    assert row_of(printed, "still", "laserscan_gaussian_noise_std_deviation")[-5:] == ["6", "6", "6", "100.0", "%"]


@each_row(
    ("share", "text"),
    [(None, "–"), (1.0, "100.0 %"), (0.9999, "99.9 %"), (0.0, "0.0 %"), (0.0001, "< 0.1 %"), (0.57, "57.0 %")],
)
def test_share_is_rounded_down(share, text):
    assert share_text(share) == text


@each_row(
    ("file", "content"),
    [
        ("picture.png", b"\x89PNG\r\n\x1a\n\x00"),
        ("metadata.json", b"{}"),
        ("coverage.json", b'{"families": {"a": 3}}'),
        ("coverage.json", b'{"families": {'),
    ],
)
def test_coverage_refuses_other_files_and_damaged_directory(file, content, tmp_path):
    (tmp_path / file).write_bytes(content)
    if file == "coverage.json":
        (tmp_path / "metadata.json").write_text("{}")
    path = tmp_path / file if file == "picture.png" else tmp_path
    assert refused("plan" if path.is_file() else "show", path, "--coverage").startswith(str(path))


@each_row(
    ("part", "key", "value"), [("environment", "combinations", "many"), ("environment", "factors", [["map_file"]])]
)
def test_show_coverage_reports_damaged_values(directory, expected, part, key, value):
    damaged = json.loads(json.dumps(expected))
    damaged["families"]["room"]["dimensions"][part][key] = value
    (directory / "coverage.json").write_text(json.dumps(damaged))
    assert "damaged campaign directory" in refused("show", directory, "--coverage")
