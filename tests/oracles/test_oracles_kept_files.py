"""Files of a campaign directory, found by the digests that scenarios have of them."""

import json
import re

import pytest

from vastflow.oracles.results.executed import NAMED_FILES, KeptFiles
from vastflow.sim.model.digest import file_digest


def test_file_is_found_by_its_bytes_wherever_it_lies_among_the_inputs(tmp_path):
    file = tmp_path / "inputs" / "deep" / "plan.fpm"
    file.parent.mkdir(parents=True)
    file.write_text("a plan")
    assert KeptFiles(tmp_path).path(file_digest(file)) == file


def test_mesh_is_found_by_the_digest_of_what_is_solid_which_is_not_that_of_its_bytes(tmp_path):
    mesh = tmp_path / "environments" / "e" / "mesh.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"triangles")
    (tmp_path / "environments" / NAMED_FILES).write_text(json.dumps({"5011d": "e/mesh.stl"}))
    assert KeptFiles(tmp_path).path("5011d") == mesh


def test_file_that_the_directory_does_not_keep_is_said(tmp_path):
    with pytest.raises(ValueError, match=re.escape("no file has the digest 0123456789ab… that the scenario names")):
        KeptFiles(tmp_path).path("0123456789abcdef")
