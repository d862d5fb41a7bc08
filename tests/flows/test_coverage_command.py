"""Coverage: in the plan of a campaign file and of a campaign directory, in words and as JSON."""

import json

import pytest
from table import each_row
from typer.testing import CliRunner

from vastflow.flows.__main__ import app
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
    """The part of a campaign directory that the command reads."""
    folder = tmp_path / "results" / "small-room-2026-11-21-120000"
    folder.mkdir(parents=True)
    (folder / "metadata.json").write_text("{}")
    (folder / "coverage.json").write_text(json.dumps(expected))
    return folder


def called(path, *options):
    """The coverage of a campaign file, planned, or of a directory, shown."""
    command = "plan" if path.is_file() else "show"
    return CliRunner().invoke(app, [command, str(path), "--coverage", *options], terminal_width=200)


def row_of(text, *begin):
    """The words of the first line that begins with `begin`."""
    return next(words for words in map(str.split, text.splitlines()) if tuple(words[: len(begin)]) == begin)


def test_json_of_a_campaign_file_is_what_instantiation_counts(campaign_file, expected):
    assert json.loads(called(campaign_file, "--json").stdout)["coverage"] == expected


def test_json_is_one_line(campaign_file):
    assert len(called(campaign_file, "--json").stdout.splitlines()) == 1


def test_json_of_a_campaign_directory_is_its_coverage_json(directory, expected):
    assert json.loads(called(directory, "--json").stdout) == expected


def test_file_and_directory_print_the_same(campaign_file, directory):
    assert called(campaign_file).stdout.startswith(called(directory).stdout)


def test_requested_is_shown_as_the_sum_of_its_parts(campaign_file):
    printed = called(campaign_file).stdout
    assert row_of(printed, "room")[1:6] == ["6", "2", "4", "0", "0"]
    assert row_of(printed, "still")[1:6] == ["6", "0", "0", "2", "4"]
    assert row_of(printed, "all")[1:6] == ["12", "2", "4", "2", "4"]


def test_coverage_names_what_constraints_and_producers_removed(campaign_file):
    printed = called(campaign_file).stdout
    assert row_of(printed, "2", "×", "room") == ["2", "×", "room", "see_enough"]
    assert row_of(printed, "4", "×", "room")[3] == "PathVariationRandom"
    assert "200 m" in printed


def test_dimensions_and_pairs_of_producers_have_their_counts(campaign_file):
    printed = called(campaign_file).stdout
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


def no_such_path(folder):
    return folder / "nowhere"


def folder_of_something_else(folder):
    return folder


def picture(folder):
    (folder / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n\x00")
    return folder / "picture.png"


def older_directory(folder):
    (folder / "metadata.json").write_text("{}")
    return folder


def damaged_directory(folder):
    (folder / "coverage.json").write_text('{"families": {"a": 3}}')
    return older_directory(folder)


def cut_off_directory(folder):
    (folder / "coverage.json").write_text('{"families": {')
    return older_directory(folder)


@each_row(
    "make",
    [no_such_path, folder_of_something_else, picture, older_directory, damaged_directory, cut_off_directory],
)
def test_path_that_is_neither_is_said_in_one_line(make, tmp_path):
    path = make(tmp_path)
    result = called(path)
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert line.startswith(str(path))


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("dimensions", "environment", "combinations"), "many"),
        (("dimensions", "environment", "factors"), [["map_file"]]),
        (("t_way", "pairs_not_listed"), {}),
    ],
)
def test_show_coverage_reports_damaged_values(directory, expected, place, value):
    damaged = json.loads(json.dumps(expected))
    *path, last = place
    part = next(iter(damaged["families"].values()))
    for key in path:
        part = part[key]
    assert last in part or last == "pairs_not_listed"
    part[last] = value
    (directory / "coverage.json").write_text(json.dumps(damaged))
    result = called(directory)
    assert (result.exit_code, "damaged campaign directory" in result.stderr) == (2, True)
