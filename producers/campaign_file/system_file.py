"""The parameter file of the system under test that a campaign names."""

from pathlib import Path
from typing import Final

from vastflow.producers.campaign_file.document import Document
from vastflow.producers.model.faults import Location, shown
from vastflow.sim.model.files import is_file
from vastflow.sim.system.keys import FILE_KEY, RELEASE_KEY
from vastflow.sim.system.system import SystemFile, system_kind

WHERE: Final[Location] = ("execution", FILE_KEY)


def system_file_of(document: Document, base: Path) -> SystemFile:
    """Read the parameter file of a campaign file, which is relative to `base`."""
    release = document.value(("execution", RELEASE_KEY))
    if not isinstance(name := document.value(WHERE), str):
        said = document.fault(("execution", RELEASE_KEY), "there is a release without a file", f"add {FILE_KEY}")
        return SystemFile(faults=(said,) if release else ())
    path = base / name
    if not is_file(path):
        return SystemFile(faults=(document.fault(WHERE, f"there is no file {shown(name)}"),))
    return system_kind().read_file(path, {RELEASE_KEY: release})
