"""A campaign directory appears whole or not at all."""

import errno
import os
import shutil
from contextlib import contextmanager
from datetime import datetime

import pytest
from table import each_row

from vastflow.flows.results.directory import directory_name, new_directory
from vastflow.sim.model.faults import UserError
from vastflow.tasks.store.store import StoreError

CREATED = datetime(2026, 11, 21, 6, 5, 4)


@contextmanager
def writes(root):
    with new_directory(root, "c", CREATED) as directory, directory.writing() as place:
        yield place


def test_name_is_the_campaigns_and_the_time_it_started(tmp_path):
    with new_directory(tmp_path / "results", "first_try", CREATED) as directory, directory.writing() as place:
        (place / "a").write_text("x")
        assert not directory.final.exists()
    assert [p.name for p in (tmp_path / "results").iterdir()] == ["first-try-2026-11-21-060504"]
    assert (directory.final / "a").read_text() == "x"


def test_campaigns_that_start_in_one_second_get_two_directories(tmp_path):
    with (
        new_directory(tmp_path, "c", CREATED) as first,
        new_directory(tmp_path, "c", CREATED) as second,
        first.writing(),
        second.writing(),
    ):
        pass
    with new_directory(tmp_path, "c", CREATED) as third, third.writing():
        pass
    assert [d.final.name for d in (first, second, third)] == [
        "c-2026-11-21-060504",
        "c-2026-11-21-060504-2",
        "c-2026-11-21-060504-3",
    ]
    assert all(d.final.is_dir() for d in (first, second, third))


@each_row("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO])
def test_full_or_broken_disk_is_reported_and_leaves_no_half_directory(tmp_path, code):
    words = rf"results: can't write to '{tmp_path}' \({os.strerror(code)}\). Make room there or .*--results. What was computed"
    with pytest.raises(UserError, match=words), writes(tmp_path) as place:
        (place / "runs.parquet").write_text("x")
        raise OSError(code, os.strerror(code), str(place / "runs.parquet"))
    assert list(tmp_path.iterdir()) == []


@each_row("error", [KeyboardInterrupt(), StoreError("can't read"), FileNotFoundError(errno.ENOENT, "x"), OSError("y")])
def test_errors_other_than_the_disks_are_raised_unchanged_and_leave_nothing(tmp_path, error):
    with pytest.raises(type(error)) as raised, writes(tmp_path) as place:
        (place / "a").write_text("x")
        raise error
    assert raised.value is error and list(tmp_path.iterdir()) == []


def test_results_folder_deleted_while_it_is_written_is_reported(tmp_path):
    words = rf"results: '{tmp_path}' was deleted while it was being written. What was computed is in the store"
    with pytest.raises(UserError, match=words), writes(tmp_path) as place:
        shutil.rmtree(tmp_path)
        (place / "runs.parquet").write_text("x")


@each_row(
    ("name", "folder"),
    [("a_b", "a-b"), ("My Campaign / 2", "My-Campaign-2"), ("../up", "up"), ("___", "campaign"), ("v1.2", "v1.2")],
)
def test_name_is_made_portable(name, folder):
    assert directory_name(name) == folder


@each_row("name", ["dangling", "file/below", "loop", "a" * 300])
def test_unusable_folder_is_reported_in_words(tmp_path, name):
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(UserError, match=r"results: can't write to .*\. Make room there or give another folder"),
        new_directory(tmp_path / name, "room", CREATED),
    ):
        raise AssertionError("it was begun")


def test_campaign_of_a_very_long_name_has_a_directory_of_a_shorter_one(tmp_path):
    with new_directory(tmp_path, "long name " * 100, CREATED) as directory, directory.writing():
        pass
    assert directory.final.is_dir() and directory.final.name.startswith("long-name-long-name")
