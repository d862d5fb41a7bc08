"""A replica: the campaign file of a campaign directory with its inputs, laid out as they lay when it was asked."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from vastflow.flows.request.asked import Asked
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.inputs import inputs_of
from vastflow.oracles.directory.unusable import UnusableDirectory
from vastflow.producers.model.faults import CampaignError
from vastflow.tasks.artifact import inside


@dataclass(frozen=True)
class Replica:
    """A campaign file that reads as it did.

    Attributes:
        map_dir: Folder of the maps that the file names from the root of the file system, for those that are no longer there.
    """

    file: Path
    map_dir: Path


@contextmanager
def replica(directory: Path, asked: Asked) -> Iterator[Replica]:
    """A copy of the campaign file and its inputs, in a folder for as long as the body takes.

    Raises:
        UnusableDirectory: an input is not in the directory, or one that the file names from the root of the file
            system is another one by now.
    """
    with TemporaryDirectory(prefix="vastflow-") as folder:
        try:
            laid_out = _laid_out(directory, asked, Path(folder))
        except (OSError, ValueError) as error:
            raise UnusableDirectory(f"{directory}: its inputs can't be read: {error}") from None
        kept = {path.read_bytes() for path in (directory / "inputs").rglob("*") if path.is_file()}
        try:
            found = inputs_of(*read_campaign(laid_out.file, laid_out.map_dir, as_v1=asked.as_v1))
        except CampaignError as error:
            words = str(error).replace(str(laid_out.file), str(directory / "campaign.vast")).replace(folder, "")
            raise UnusableDirectory(f"{directory}: its inputs can't be read any more: {words}") from None
        if other := sorted(name for name, content in found.files.items() if content not in kept):
            raise UnusableDirectory(
                f"{directory}: {', '.join(other)} is another file now than in its inputs; put back the one that was used, "
                "or run the campaign file itself"
            )
        yield laid_out


def _laid_out(directory: Path, asked: Asked, folder: Path) -> Replica:
    """Copy the inputs into `folder`, those from outside of the campaign file's folder outside of it again."""
    above = max((Path(place).parts.count("..") for place in asked.places), default=0)
    root = folder / "campaign"
    base = root.joinpath(*["campaign"] * above)
    base.mkdir(parents=True)
    inputs, outside = directory / "inputs", set(asked.places.values())
    for path in sorted(inputs.rglob("*")):
        name = path.relative_to(inputs).as_posix()
        if path.is_file() and name not in outside:
            _copy(path, base / name)
    for place, name in asked.places.items():
        if (inputs / name).is_file():
            target = os.path.relpath(os.path.normpath(base / place), folder)
            _copy(inside(inputs, name), inside(folder, target))
    file = inside(base, asked.file)
    _copy(directory / "campaign.vast", file)
    return Replica(file, root)


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
