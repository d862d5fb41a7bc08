"""The colors of all figures and of the report.

Those of Okabe and Ito, told apart by people with any common color blindness; every judgement and class has a shape, a place or
a word of its own beside its color. Rates and densities are viridis from yellow (little) to purple (much), which is in order in gray, too.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from vastflow.oracles.judgement.verdict import Judgement

if TYPE_CHECKING:
    from vastflow.oracles.statistics.classes import ClassName

COLORS: Final[Mapping[Judgement, str]] = {"pass": "#0072B2", "fail": "#D55E00", "not judged": "#8A8A8A"}
CLASS_COLORS: Final["Mapping[ClassName, str]"] = {
    "reliable": "#0072B2",
    "systematic": "#D55E00",
    "flaky": "#E69F00",
    "undecided": "#8A8A8A",
}
OBSTACLE_COLOR: Final = "#CC79A7"
OBSTACLE_EDGE: Final = "#8F4A72"
KEEPOUT_COLOR: Final = "#7A3B10"
SPEED_COLOR: Final = "#F0E442"
GOAL_COLOR: Final = "#009E73"
INK: Final = "#22262B"
SOFT_INK: Final = "#6B7280"
LINE: Final = "#E2E5E8"
RATES: Final = "viridis_r"
"""Name of matplotlib's color map for rates and densities."""
