"""The plug-ins with kernels of parameters that stand apart from them."""

import functools
from collections.abc import Mapping
from typing import Any, Final

from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.nav2.controllers.dwb import Dwb
from vastflow.sim.nav2.controllers.mppi import Mppi
from vastflow.sim.nav2.controllers.rpp import Rpp
from vastflow.sim.nav2.planners.navfn_planner import NavFnPlanner
from vastflow.sim.nav2.planners.smac_2d import Smac2D
from vastflow.sim.nav2.planners.smac_hybrid import SmacHybrid
from vastflow.sim.world.gaussian_dropout import GaussianDropout

_KERNELS: Final[Mapping[type[ParameterGroup], Any]] = {
    kind.__bases__[0]: kind for kind in (Dwb, GaussianDropout, Mppi, NavFnPlanner, Rpp, Smac2D, SmacHybrid)
}


@functools.lru_cache(maxsize=64)
def with_kernels(parameters: ParameterGroup) -> Any:
    """Return the plug-in with these parameters; one of its author's own is both."""
    kind = _KERNELS.get(type(parameters))
    return parameters if kind is None else kind(**dict(parameters))
