"""Names of a campaign directory's maps, for people; a map is known by its digest alone otherwise."""

from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from vastflow.sim.model.files import read_json
from vastflow.sim.world.map_file import map_content


def environment_names(directory: Path, environments: Iterable[str]) -> dict[str, str]:
    """Digest to the name of the map's file, or of the floor plan that it was made of; a number tells equal names apart."""
    wanted = list(environments)
    files = dict(_named_files(directory / "inputs"))
    names = {digest: _plan(directory / "environments" / digest) or files.get(digest, digest[:8]) for digest in wanted}
    times = Counter(names.values())
    seen: Counter[str] = Counter()
    for digest, name in names.items():
        if times[name] > 1:
            seen[name] += 1
            names[digest] = f"{name} {seen[name]}"
    return names


def _named_files(inputs: Path) -> Iterable[tuple[str, str]]:
    for file in sorted(inputs.rglob("*.y*ml")):
        with suppress(ValueError, OSError):
            yield map_content(file).digest, file.stem


def _plan(environment: Path) -> str | None:
    """Name of the plan's file, as the provenance beside a producer's map has it."""
    with suppress(ValueError, OSError, KeyError, TypeError):
        said = read_json(environment / "provenance.json")
        return Path(str(said["file"])).stem
    return None
