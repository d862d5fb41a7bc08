"""Finding planners: by Nav2's plug-in name, or in a file."""

from typing import Final

from vastflow.sim.nav2.parameters.servers import NavFn, SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.planners.planner import Planner
from vastflow.sim.plug_ins.registry import Registry

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
