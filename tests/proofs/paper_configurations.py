"""Compare the number of configurations of the paper's campaigns with the paper.

    python tests/proofs/paper_configurations.py [--map-dir FOLDER]

Instantiates all of them, which takes some minutes, and ends with 1 where a count differs. Without the folder of the paper's maps it
looks at our floor plans alone. `tests/campaigns/test_paper.py` has the same for single plans.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

from paper_published import PUBLISHED, Kind
from paper_results import Requested, requested_of

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate

PAPER: Final = Path(__file__).parents[2] / "campaigns" / "paper"

EQUAL: Final = 390
"""Settings of `safety` on a map of the paper that are equal to another one, such as no obstacle at any spread: the paper counts them."""


def counted(kind: Kind) -> Requested:
    """The paper's counts, without losses."""
    n = PUBLISHED[kind].configurations
    return Requested(n, 0, 0, 0, n)


ON_ITS_MAPS: Final = {
    "performance": Requested(1866, 50, 0, 0, PUBLISHED["performance"].configurations),
    "robustness": counted("robustness"),
    "safety": Requested(2160, 288, 0, EQUAL, PUBLISHED["safety"].configurations - EQUAL),
}
"""Without a path: of 20 m on its smallest map, whose cells the paper's counts lack."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map-dir", type=Path, help="folder of the paper's maps")
    maps = parser.parse_args(arguments).map_dir
    wanted = {f"{kind}.vast": counted(kind) for kind in ("performance", "robustness")}
    if maps is not None:
        wanted |= {f"original-maps/{kind}.vast": expected for kind, expected in ON_ITS_MAPS.items()}
    differ = False
    for file, expected in wanted.items():
        found = requested_of(instantiate(read_campaign(PAPER / file, maps)[0]).coverage)
        differ |= found != expected
        print(f"{file}: {found}" + ("" if found == expected else f", and not {expected}"), flush=True)
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
