"""The benchmark of a Dask cluster, in short."""

import pytest
from bench_cluster import measured


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_workers_are_busy_with_units_of_seconds(tmp_path):
    found = measured(slots=8, ideal_s=10.0, folder=tmp_path)
    assert (found["slots"], found["units"]) == (8, 80)
    assert found["efficiency"] > 0.5, "on a machine that others use"
