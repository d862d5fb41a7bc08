"""Finding controllers and planners: by Nav2's plug-in name, by a campaign file's short name, or in a file."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import NavFn, SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.planners.planner import Planner
from vastflow.sim.plug_ins.registry import Registry

CONTROLLER_PLUG_INS: Final = Registry(
    "vastflow.controllers",
    "controller",
    Controller,
    "parameter file",
    {
        "vastflow.sim.nav2.controllers.dwb:Dwb": DwbParameters,
        "vastflow.sim.nav2.controllers.mppi:Mppi": MppiParameters,
        "vastflow.sim.nav2.controllers.rpp:Rpp": RppParameters,
    },
)


find_controller = CONTROLLER_PLUG_INS.find


def short_names() -> Mapping[str, str]:
    """Short names of installed controllers, as the key `controller` has them, to their names in the group."""
    return dict(sorted((entry.attr.lower(), name) for name, entry in CONTROLLER_PLUG_INS.known.items()))


def short_name(name: str) -> str:
    """Return the short name of an installed controller, or the class of one in a file."""
    entry = CONTROLLER_PLUG_INS.known.get(name)
    return name.rpartition(":")[2] if entry is None else entry.attr.lower()


PLANNER_PLUG_INS: Final = Registry(
    "vastflow.planners",
    "planner",
    Planner,
    "parameter file",
    {
        "vastflow.sim.nav2.planners.navfn_planner:NavFnPlanner": NavFn,
        "vastflow.sim.nav2.planners.smac_2d:Smac2D": SmacPlanner2D,
        "vastflow.sim.nav2.planners.smac_hybrid:SmacHybrid": SmacPlannerHybrid,
    },
)

find_planner = PLANNER_PLUG_INS.find
