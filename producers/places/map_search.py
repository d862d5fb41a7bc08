"""Where the maps are that a campaign file names: beside it, or in a folder that the user gives."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.files import is_file
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.world.map_file import MissingMap, map_content


@dataclass
class MapSearch:
    """Finds the maps of one campaign file.

    A map is looked for below the file's folder first, then by the same relative path below `map_dir`. Of an absolute path, which is one
    of another machine, the longest end counts that is there. Where it was found is in no digest: those cover what the maps hold.

    Attributes:
        base: The campaign file's folder.
        map_dir: Folder of maps that are not beside the file.
        borrowed: Path of each map that was found there, to its name in the campaign file; grows with `content`.
    """

    base: Path
    map_dir: Path | None = None
    borrowed: dict[str, str] = field(default_factory=dict)

    def content(self, name: str) -> FileContent:
        """The map that the campaign file calls `name`.

        Raises:
            MissingMap: it is in neither place.
            MapError: it is no map.
            ValueError: the name is none that a file can have.
        """
        path = self.base / name
        if is_file(path):
            return map_content(path)
        if self.map_dir is None:
            if os.path.lexists(path):
                return map_content(path)
            raise MissingMap(
                f"{path}: no such file; a map is a map_server YAML file, here or at this place in a folder that --map-dir names"
            )
        there = [self.map_dir / end for end in _ends(name)]
        borrowed = next((each for each in there if is_file(each)), None)
        if borrowed is None:
            offered = self._offered()
            right = did_you_mean(name, offered) if offered else f"another --map-dir; {self.map_dir} has no map"
            raise MissingMap(f"{path}: no such file, and no {there[-1]}; {right}")
        found = map_content(borrowed)
        self.borrowed[found.path] = name
        return found

    def _offered(self) -> list[str]:
        """Names of what may be maps in `map_dir`, at most two folders deep: it may be a home folder by mistake."""
        assert self.map_dir is not None
        patterns = ("*.yaml", "*/*.yaml", "*/*/*.yaml")
        found = [file for pattern in patterns for file in self.map_dir.glob(pattern)]
        return sorted(Path(os.path.relpath(file, self.map_dir)).as_posix() for file in found)


def _ends(name: str) -> list[str]:
    """What to look for below another folder: a relative path as it is, of an absolute one its ends, the longest first."""
    parts = Path(name).parts
    return ["/".join(parts[k:]) for k in range(1, len(parts))] if Path(name).is_absolute() else [name]
