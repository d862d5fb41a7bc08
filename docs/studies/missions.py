"""Campaigns that proofs derive from others, run by vastflow, and their runs as a table."""

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from vastflow.flows import run_campaign
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.digest import digest

MAPS = Path(__file__).parents[3] / "shared" / "maps"


def parser_of(about: str | None) -> ArgumentParser:
    """A parser whose help is the proof's own text."""
    return ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)


def map_parser(about: str | None) -> ArgumentParser:
    """Options of all proofs on the paper's maps."""
    parser = parser_of(about)
    parser.add_argument("--maps", type=Path, default=MAPS, metavar="DIR", help="folder of <name>/<name>.yaml")
    parser.add_argument("--only", action="append", metavar="NAME", help="this map alone; may be repeated")
    return parser


def map_files(maps: Path, only: Iterable[str] | None) -> list[Path]:
    """Return the requested maps.

    Raises:
        SystemExit: with 2, there are none.
    """
    files = sorted(file for file in maps.glob("*/*.yaml") if not only or file.stem in only)
    if not files:
        of_names = f" for {' or '.join(only)}" if only else ""
        print(
            f"{maps}: expected maps NAME/NAME.yaml{of_names}, got none. The five maps of the paper's study are in the history of "
            "https://github.com/cps-test-lab/robovast, below configs/dataset/maps",
            file=sys.stderr,
        )
        raise SystemExit(2)
    return files


def random_paths(
    map_file: Path,
    controller: str,
    path: Mapping[str, float],
    parameters: Mapping[str, float] | None = None,
    more: Iterable[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """A family of random paths on a map.

    Args:
        path: Parameters of `PathVariationRandom`, beside those that are the same for all.
        parameters: Further parameters of the family.
        more: Producers after the paths.
    """
    given = {"map_file": str(map_file.resolve()), "robot_radius": 0.22, "controller": controller, **(parameters or {})}
    paths = {"min_distance": 1.0, "robot_diameter": 0.5, "seed": 42, "goal_poses": "@goal_pose", **path}
    variations = [{"PathVariationRandom": paths}, *more]
    return {"name": map_file.stem, "parameters": [{key: given[key]} for key in given], "variations": variations}


def written(folder: Path, **sections: Any) -> Path:
    """A campaign file of sections."""
    file = folder / "campaign.vast"
    file.write_text(yaml.safe_dump({"version": 1, "execution": {"runs": 1}, **sections}), encoding="utf-8")
    return file


def sections_of(campaign: Path) -> dict[str, Any]:
    """The sections of a shipped campaign, for a copy in another folder."""
    return dict(yaml.safe_load(campaign.read_text(encoding="utf-8").replace("../", f"{campaign.parents[1]}/")))


def situations(campaign: Path, factor: str, levels: int, count: int) -> list[Sequence[Configuration]]:
    """Configurations that differ in one factor alone, in groups with all of its levels, evenly spread over a campaign."""
    found: dict[str, list[Configuration]] = {}
    for each in instantiate(load_campaign(campaign)).configurations:
        alike = {key: value for key, value in each.factors.items() if not key.endswith(factor)}
        found.setdefault(digest(each.family, alike), []).append(each)
    whole = [group for group in found.values() if len(group) == levels]
    return [whole[k] for k in np.unique(np.linspace(0, len(whole) - 1, min(count, len(whole))).astype(int))]


def runs_of(campaign: Path, **options: Any) -> pd.DataFrame:
    """Run a campaign; a row for each run with its outcome, verdicts, metrics, and what varies."""
    return run_campaign(campaign, results=campaign.parent / "results", **options).frame()
