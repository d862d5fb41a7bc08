"""The base class of export formats, and a campaign as it is given to them."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final, TypeAlias

from vastflow.flows.export.run import ExportedRun
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import Registry

ExportedFile: TypeAlias = tuple[str, bytes | Path]
"""Place below the export's folder, with `/`, and the content, or a file to copy."""


@dataclass(frozen=True)
class ExportedConfiguration:
    """A configuration with its runs.

    Attributes:
        scenario: Name of its scenario.
        values: Values of the scenario's parameters; a file is its place in `ExportedCampaign.files`, as a `PurePosixPath`.
        provenance: Notes of its producers, such as `_path_length` in m.
        duplicate_of: The configuration of the same content that ran in its place; None if it ran itself.
        runs: In the order of their index, each read when its turn comes; none of a duplicate.
    """

    name: str
    family: str
    scenario: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    duplicate_of: str | None = None
    runs: Iterable[ExportedRun] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ExportedCampaign:
    """A finished campaign, or those of its configurations that are to be exported.

    Attributes:
        headline: Result of the campaign in a sentence; empty if configurations were chosen.
        files: The campaign file and all that it names, by their places in its folder.
        metadata: Content of its `metadata.json`.
        evaluations: Rows of a search's `evaluations.parquet`.
    """

    name: str
    headline: str = ""
    configurations: Sequence[ExportedConfiguration] = ()
    files: Mapping[str, Path] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)
    evaluations: Sequence[Mapping[str, Any]] = ()


class Format(ABC):
    """A form in which other tools read a campaign; a subclass is made without arguments.

    Attributes:
        executes: Whether it executes runs, which may need the user's consent.
    """

    executes: ClassVar[bool] = False

    @abstractmethod
    def files(self, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
        """Yield the files of the export, each once, in an order of its own; nothing is written elsewhere."""


FORMATS: Final[Registry[Format]] = Registry(
    "vastflow.formats",
    "format",
    Format,  # type: ignore[type-abstract]
    "working directory",
    is_beside_campaign=True,
)


def format_of(name: str, base: Path) -> Format:
    """Return the format called `name` in the entry-point group, or `file.py:Class` relative to `base`.

    Raises:
        UserError: there is none of this name, or its code raises.
    """
    try:
        with plug_in_code():
            made: Format = FORMATS.find(name, base)()
    except PlugInError as error:
        raise UserError(str(error)) from None
    except Exception as error:
        raise _broken(name, error) from error
    return made


def files_of_format(chosen: Format, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
    """Yield what a format does; raises UserError where its code raises something else."""
    try:
        with plug_in_code():
            files = iter(chosen.files(campaign))
        while True:
            with plug_in_code():
                file = next(files, None)
            if file is None:
                return
            yield file
    except (UserError, OSError):
        raise
    except Exception as error:
        raise _broken(type(chosen).__name__, error) from error


def _broken(name: str, error: Exception) -> UserError:
    return UserError(message_of(f"format {name!r} raised {type(error).__name__}", str(error)))
