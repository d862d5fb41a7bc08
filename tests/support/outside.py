"""Inputs that are not part of the checkout: RoboVAST's configurations, and the maps of the paper's study."""

import os
from pathlib import Path

import pytest

SHARED = Path(__file__).parents[3] / "shared"
ROBOVAST = os.environ.get("ROBOVAST_CONFIGS")
"""The folder `configs` of a clone of RoboVAST, with programs and notebooks."""

CONFIGS = Path(ROBOVAST) if ROBOVAST else SHARED / "upstream" / "robovast-configs"
"""RoboVAST's configurations; beside the repository they are data alone."""
NO_CONFIGS = "set ROBOVAST_CONFIGS to the folder `configs` of a clone of https://github.com/cps-test-lab/robovast"

PAPER_MAPS = SHARED / "maps"
NO_MAPS = (
    "the five maps of the paper's study are not beside the repository; "
    "the history of https://github.com/cps-test-lab/robovast has them below configs/dataset/maps"
)


def robovast_file(name):
    """Return the place of one of RoboVAST's files; skip the test where it is missing and no clone is named."""
    if not ROBOVAST and not (CONFIGS / name).is_file():
        pytest.skip(f"{name} is not here: {NO_CONFIGS}")
    return CONFIGS / name


def paper_map(name):
    """Return one of the paper's maps, or skip the test where it is missing."""
    file = PAPER_MAPS / name / f"{name}.yaml"
    if not file.is_file():
        pytest.skip(f"{name}: {NO_MAPS}")
    return file
