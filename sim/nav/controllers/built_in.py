"""vastflow's own controllers by their parameters, which are read without them: a controller has kernels, and needs numba."""

import functools
from collections.abc import Mapping
from typing import Any, Final

from vastflow.sim.nav.controllers.controller import Controller
from vastflow.sim.nav.controllers.dwb import Dwb
from vastflow.sim.nav.controllers.mppi import Mppi
from vastflow.sim.nav.controllers.rpp import Rpp
from vastflow.sim.nav.parameters.parameter import ParameterGroup

_CONTROLLERS: Final[Mapping[type[ParameterGroup], Any]] = {kind.__bases__[0]: kind for kind in (Dwb, Mppi, Rpp)}


def controller_of(parameters: ParameterGroup) -> Controller:
    """The controller with these parameters; a plug-in is both."""
    return parameters if isinstance(parameters, Controller) else _controller_of(parameters)


@functools.lru_cache(maxsize=64)
def _controller_of(parameters: ParameterGroup) -> Controller:
    found: Controller = _CONTROLLERS[type(parameters)](**dict(parameters))
    return found
