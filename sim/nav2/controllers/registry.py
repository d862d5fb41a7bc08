"""Finding controllers: by Nav2's plug-in name, by a campaign file's short name, or in a file."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.nav2.controllers.controller import Controller
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
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
