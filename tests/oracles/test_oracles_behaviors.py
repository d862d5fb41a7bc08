"""The behaviors of a campaign directory, by configuration."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vastflow.oracles.results.behaviors import BEHAVIORS_FILE, Behaviors
from vastflow.sim.model.archive import write_table


@pytest.fixture
def directory(tmp_path):
    """Three configurations in two row groups; `b` is in both."""
    table = pa.table(
        {
            "configuration": ["a", "b", "b", "c"],
            "run_index": pa.array([0, 0, 1, 0], pa.int64()),
            "t_s": [0.5, 1.5, 2.5, 3.5],
            "name": ["drive", "wait", "", "drive"],
        }
    )
    pq.write_table(table, tmp_path / BEHAVIORS_FILE, row_group_size=2)
    return tmp_path


def plain(columns):
    return {name: column.tolist() for name, column in columns.items()}


def test_configuration_has_its_rows_from_every_row_group(directory):
    assert plain(Behaviors(directory).of("b")) == {"run_index": [0, 1], "t_s": [1.5, 2.5], "name": ["wait", ""]}


def test_configurations_may_be_asked_for_in_any_order(directory):
    behaviors = Behaviors(directory)
    assert [plain(behaviors.of(name))["t_s"] for name in ("c", "a", "c")] == [[3.5], [0.5], [3.5]]


def test_columns_have_the_types_of_the_table(directory):
    columns = Behaviors(directory).of("a")
    assert {name: column.dtype for name, column in columns.items()} == {
        "run_index": np.dtype(np.int64),
        "t_s": np.dtype(np.float64),
        "name": np.dtype(object),
    }


def test_configuration_without_a_recorded_run_has_none(directory, tmp_path):
    assert Behaviors(directory).of("d") == {}
    assert Behaviors(tmp_path / "elsewhere").of("a") == {}


def test_directory_of_an_earlier_version_has_a_file_for_each_configuration(tmp_path):
    (tmp_path / "behaviors").mkdir()
    own = write_table({"run_index": np.array([0]), "t_s": np.array([0.5])})
    (tmp_path / "behaviors" / "a.parquet").write_bytes(own)
    assert plain(Behaviors(tmp_path).of("a")) == {"run_index": [0], "t_s": [0.5]}


def test_damaged_file_is_an_error(tmp_path):
    (tmp_path / BEHAVIORS_FILE).write_bytes(b"damaged")
    with pytest.raises(ValueError, match="Parquet"):
        Behaviors(tmp_path).of("a")
