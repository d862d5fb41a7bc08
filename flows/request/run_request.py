"""The request: all that a run of a campaign is asked, in plain JSON values.

One model behind the command `run`, `run_campaign`, the form on Prefect's pages, and schedules: an option is a field here, and the
place that uses it.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from inspect import Parameter
from typing import Annotated, Any, Final, Literal, Self, TypeAlias, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError, field_validator

from vastflow.tasks.store.artifact import public_address

Text: TypeAlias = Annotated[str, StringConstraints(min_length=1)]
OneOrMore: TypeAlias = Annotated[int, Field(ge=1)]
ForcedStage: TypeAlias = Literal["all", "instantiate", "execute", "observe", "judge"]


@dataclass(frozen=True, slots=True)
class OnCommandLine:
    """Option of a request's field, where the word for its value does not follow from the field."""

    metavar: str | None = None


class RunRequest(BaseModel):
    """A run of a campaign."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    campaign: Annotated[Text, OnCommandLine("FILE")] = Field(description="Campaign file.")
    runs: OneOrMore | None = Field(None, description="Runs per configuration (default: as in the file).")
    results: Text = Field(
        "results", description="Folder or address, such as s3://bucket/prefix, for campaign directories."
    )
    store: Text | None = Field(
        None, description="Store: a folder or an address (default: $VASTFLOW_STORE or the user's cache)."
    )
    workers: OneOrMore | None = Field(None, description="Worker processes (default: one per core).")
    only: Annotated[tuple[Text, ...], OnCommandLine("NAME")] = Field(
        (), description="Run only this family or configuration (may be repeated)."
    )
    sample: Annotated[OneOrMore | None, OnCommandLine("N")] = Field(
        None, description="Run a reproducible sample of N distinct configurations."
    )
    map_dir: Annotated[Text | None, OnCommandLine("FOLDER")] = Field(
        None,
        description="Folder of maps that are not beside the campaign file, at the same relative paths.",
    )
    strict: bool = Field(False, description="Treat unknown keys in the file as errors.")
    force: Annotated[ForcedStage | None, OnCommandLine("[STAGE]")] = Field(
        None,
        description="Compute again what the store has: all, or only the stage instantiate, execute, observe, or judge. What follows from "
        "results that come out as before is kept.",
    )
    cluster: Annotated[Text | None, OnCommandLine("ADDRESS")] = Field(
        None,
        description="Dask cluster that computes missing runs: tcp://…, tls://…, a scheduler file, or local:N for N workers here "
        "(default: $DASK_SCHEDULER_ADDRESS, else this machine).",
    )
    reports: Annotated[Text | None, OnCommandLine("URL")] = Field(
        None, description="Web address of the results folder, for links to reports."
    )

    @field_validator("campaign", "results", "store", "map_dir", mode="before")
    @classmethod
    def _plain(cls, place: Any) -> Any:
        return os.fspath(place) if isinstance(place, os.PathLike) else place

    @field_validator("only", mode="before")
    @classmethod
    def _several(cls, names: Any) -> Any:
        return () if names is None else (names,) if isinstance(names, str) else names

    @field_validator("force", mode="before")
    @classmethod
    def _stage(cls, force: Any) -> Any:
        """Return the forced stage, which may be given as a bool."""
        if force is not None and not isinstance(force, bool) and force not in get_args(ForcedStage):
            raise ValueError(f"--force: expected {', '.join(get_args(ForcedStage))}, or nothing, got {force!r}")
        return ("all" if force else None) if isinstance(force, bool) else force

    @field_validator("cluster", mode="before")
    @classmethod
    def _address(cls, cluster: Any) -> Any:
        """Return the address of a cluster, which may be given as a `distributed.Client`."""
        address = getattr(getattr(cluster, "scheduler", None), "address", cluster)
        address = os.fspath(address) if isinstance(address, os.PathLike) else address
        if isinstance(address, str) and not _CLUSTER.fullmatch(address) and not os.path.isfile(address):
            raise ValueError(
                "--cluster: expected tcp://HOST:PORT, tls://HOST:PORT, a scheduler file, or local:N, "
                f"got {address!r}, and no such file exists"
            )
        return address

    @property
    def forced(self) -> tuple[str, ...]:
        """The stages that are computed again."""
        return get_args(ForcedStage)[1:] if self.force == "all" else tuple(filter(None, [self.force]))

    def public(self) -> Self:
        """Return the request without credentials in its addresses, as others may read what keeps it."""
        named = {name: getattr(self, name) for name in ("store", "results", "cluster", "reports")}
        return self.model_copy(update={name: public_address(place) for name, place in named.items() if place})


_CLUSTER: Final = re.compile(r"(tcp|tls|ws|wss|ucx|inproc)://\S+|local:[1-9]\d*")

NAMES: Final = tuple(name for name in RunRequest.model_fields if name != "campaign")
"""Options of a request: all fields but the campaign file."""


def request_of(campaign: "str | os.PathLike[str] | RunRequest", options: Mapping[str, Any]) -> RunRequest:
    """The request for a campaign with options.

    Raises:
        ValueError: an option is out of its bounds, in words such as `runs is at least 1, got 0`.
        TypeError: there is no such option.
    """
    if unknown := sorted(options.keys() - {*NAMES}):
        raise TypeError(f"expected an option of {', '.join(NAMES)}, got {unknown[0]!r}")
    try:
        if isinstance(campaign, RunRequest):
            return RunRequest.model_validate({**campaign.model_dump(), **options})
        return RunRequest.model_validate({"campaign": campaign, **options})
    except ValidationError as error:
        first = error.errors()[0]
        name, found = ".".join(map(str, first["loc"])), first["input"]
        if first["type"] == "value_error":
            raise ValueError(first["msg"].removeprefix("Value error, ")) from None
        bound = first.get("ctx", {}).get("ge")
        said = f"is at least {bound:g}" if bound is not None else first["msg"].lower()
        raise ValueError(f"{name} {said}, got {found!r}") from None


def command_line(request: RunRequest) -> list[str]:
    """Return the arguments of `vastflow run` for this request."""
    words = [request.campaign]
    for name, value in request.model_dump(exclude_defaults=True, exclude={"campaign"}).items():
        flag = f"--{name.replace('_', '-')}"
        several = value if isinstance(value, list | tuple) else (value,)
        words += [word for each in several for word in ([flag] if each is True else [flag, str(each)])]
    return words


def option_parameters() -> list[Parameter]:
    """Return the options of a request as function parameters."""
    return [
        Parameter(name, Parameter.KEYWORD_ONLY, default=about.get_default(), annotation=about.annotation)
        for name, about in RunRequest.model_fields.items()
        if name in NAMES
    ]


SEQUENTIAL: Final = "sequential"
"""Key of `metadata.json` with the rule by which the runs of each configuration ended, if they did."""
SEARCH: Final = "search"
"""Key of `metadata.json` with what was searched and found, if the campaign was a search."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The request of a finished campaign.

    Attributes:
        runs: Number of runs of each configuration; the maximum where they end by a rule.
        places: File from outside of the campaign file's folder, relative to that, to its place below `inputs/`.
        only, sample: See `RunRequest`.
        sequential: Whether they end by the file's rule.
    """

    file: str
    runs: int
    only: tuple[str, ...] = ()
    places: Mapping[str, str] = field(default_factory=dict)
    sample: int | None = None
    sequential: bool = False

    @property
    def fixed_runs(self) -> int | None:
        """Runs to ask for instead of the file's; None where the file's rule ended them."""
        return None if self.sequential else self.runs

    def as_json(self) -> dict[str, Any]:
        """Plain values; the rule is elsewhere in `metadata.json`."""
        plain = {**asdict(self), "only": list(self.only)}
        del plain["sequential"]
        return plain


def asked_of(metadata: Mapping[str, Any]) -> Asked:
    """Return the request of a campaign directory.

    Raises:
        KeyError, TypeError, ValueError: its `metadata.json` does not say.
    """
    said = metadata["asked"]
    try:
        return _ASKED.validate_python({**said, "sequential": bool(metadata.get(SEQUENTIAL))})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, ("asked", *first["loc"])))
        raise ValueError(f"metadata.json: {where}: {first['msg']}, got {first['input']!r}"[:200]) from None


_ASKED: Final = TypeAdapter(Asked)
