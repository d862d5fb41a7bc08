"""Controllers that robots are driven by: which of them a campaign needs compiled."""

from collections.abc import Iterable, Mapping

from vastflow.sim.model.digest import Value
from vastflow.sim.nav2.parameter_files.chosen import CONTROLLER_KEY, parameters_of
from vastflow.sim.nav2.parameter_files.document import DocumentError
from vastflow.sim.nav2.parameter_files.parameter_file import FILE_KEY


def controllers_in(systems: Iterable[Mapping[str, Value]]) -> list[dict[str, Value]]:
    """Of system dimensions the part that chooses a controller, one for each controller, in the order in which they come.

    One whose parameters can't be read is left out: its runs say why.
    """
    found: dict[type, dict[str, Value]] = {}
    for system in systems:
        choice = {key: system[key] for key in (FILE_KEY, CONTROLLER_KEY) if key in system}
        try:
            found.setdefault(type(parameters_of(choice).controller), choice)
        except DocumentError:
            continue
    return list(found.values())
