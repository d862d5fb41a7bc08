"""Arguments and options of commands; a run's options are the fields of `RunRequest`."""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias, get_args

import typer

from vastflow.flows.request.run_request import ForcedStage, OnCommandLine, RunRequest
from vastflow.sim.model.faults import UserError

CampaignFile: TypeAlias = Annotated[Path, typer.Argument(metavar="FILE", help="Campaign file.")]
ResultsFolder: TypeAlias = Annotated[
    Path, typer.Argument(metavar="RESULTS", help="A campaign directory, as `vastflow run` names it.")
]
PlaceOfResults: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="RESULTS",
        help="A campaign directory, as `vastflow run` names it: a folder, or an address such as s3://bucket/NAME.",
    ),
]


def _named(context: typer.Context, argument: str) -> Path:
    """Return the first argument before the cursor; click leaves it unsorted where an option lacks its value."""
    return Path(context.params[argument] or context.args[0])


def configuration_names(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the campaign directory before the cursor that begin so, for the Tab key."""
    from vastflow.oracles.results.schema import table_rows

    try:
        rows = table_rows(_named(context, "results") / "configurations.parquet", "name")
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return [row["name"] for row in rows if row["name"].startswith(incomplete)]


def names_to_run(context: typer.Context, incomplete: str) -> list[str]:
    """Return families of the campaign file before the cursor and configurations of its newest directory, for the Tab key.

    The file is read as YAML alone: what its producers would make is not known without executing them.
    """
    from vastflow.oracles.results.schema import table_rows
    from vastflow.producers.campaign_file.document import read_document
    from vastflow.sim.model.files import read_json

    found: dict[str, None] = {}
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
        source = _named(context, "source")
        directory: Path | None = source
        if source.is_file():
            data = read_document(source).data
            found |= dict.fromkeys(str(family["name"]) for family in data.get("configuration") or ())
            name = (data.get("metadata") or {}).get("name") or source.stem
            results = Path(context.params.get("results") or "results").glob("[!.]*/metadata.json")
            named = [(file.stat().st_mtime_ns, file.parent) for file in results if read_json(file)["name"] == str(name)]
            directory = max(named)[1] if named else None
        for row in table_rows(directory / "configurations.parquet", "name", "family") if directory else ():
            found |= {row["family"]: None, row["name"]: None}
    return [name for name in found if name.startswith(incomplete)]


def run_names(context: typer.Context, incomplete: str) -> list[str]:
    """Return names of configurations as `configuration_names` does, of a single one its runs as `CONFIGURATION/RUN`."""
    from vastflow.oracles.results.schema import rows_of

    names = configuration_names(context, incomplete.rpartition("/")[0] or incomplete)
    chosen = [name for name in names if incomplete.startswith(f"{name}/")] or names
    if len(chosen) != 1:
        return chosen
    try:
        rows = rows_of(Path(context.params["results"]) / "verdicts.parquet", "configuration", chosen[0])
        runs = sorted(set(rows["run_index"].to_pylist()))
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return [each for run in runs if (each := f"{chosen[0]}/{run}").startswith(incomplete)]


def configuration_and_run(text: str) -> tuple[str, int]:
    """Read `CONFIGURATION/RUN`; raises `UserError` for anything else."""
    configuration, _, index = text.rpartition("/")
    if not (configuration and index.isascii() and index.isdecimal() and len(index) < 10):
        raise UserError(f"expected CONFIGURATION/RUN, such as room-1/0, got {text!r}")
    return configuration, int(index)


ConfigurationName: TypeAlias = Annotated[
    str,
    typer.Argument(metavar="CONFIGURATION", help="Name of a configuration.", autocompletion=configuration_names),
]
Out: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Folder to write to instead of the default.")
]
OracleName: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAME", help="Use the verdicts of this oracle alone.")
]
AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print JSON and nothing else.")]
Markdown: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write it as Markdown too, for the summary of a job in CI."),
]
DryRun: TypeAlias = Annotated[bool, typer.Option("--dry-run", help="Print what would change, and change nothing.")]
Context: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAME", help="Cluster whose resources apply (default: the first in the file).")
]


def command_group(title: str) -> typer.Typer:
    """Return an empty group of commands."""
    return typer.Typer(help=title, no_args_is_help=True, rich_markup_mode=None)


_TYPES: Final[Mapping[str, Any]] = {"integer": int, "number": float, "string": str, "boolean": bool, "array": list[str]}


def with_stages(arguments: Sequence[str]) -> list[str]:
    """Add `all` to a --force without a stage, as before a file.

    Typer has no options whose value may be left out.
    """
    words = []
    for word, behind in zip(arguments, [*arguments[1:], "-"], strict=True):
        is_other = behind not in get_args(ForcedStage) and (not behind.isalpha() or os.path.exists(behind))
        is_bare = word == "--force" and is_other
        words += [word, "all"] if is_bare else [word]
    return words


def asking(*names: str, **defaults: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Add the options of these fields, with other defaults, to a command, which gets their values as the mapping `asked`."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        parameters: list[Parameter] = []
        for parameter in signature(command).parameters.values():
            options = (_option(name, defaults) for name in names)
            parameters += options if parameter.name == "asked" else [parameter]

        @functools.wraps(command)
        def called(**values: Any) -> None:
            command(asked={name: values.pop(name) for name in names}, **values)

        del called.__wrapped__
        called.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return called

    return decorated


def _option(name: str, defaults: Mapping[str, Any]) -> Parameter:
    about, schema = RunRequest.model_fields[name], _schemas()[name]
    schema = next((each for each in schema.get("anyOf", ()) if each["type"] != "null"), schema)  # of the value
    default = defaults.get(name, None if schema["type"] == "array" else about.get_default())
    said = next((each for each in about.metadata if isinstance(each, OnCommandLine)), OnCommandLine())
    option = typer.Option(
        metavar=said.metavar,
        min=schema.get("minimum"),
        help=about.description,
        callback=_map_dir if name == "map_dir" else None,
        autocompletion=names_to_run if name == "only" else None,
    )
    kind: Any = _TYPES[schema["type"]]
    annotated: Any = Annotated  # made of values here, which a checker of types can't follow
    annotation = annotated[kind | None if default is None else kind, option]
    return Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=annotation)


@functools.cache
def _schemas() -> Mapping[str, Any]:
    properties: Mapping[str, Any] = RunRequest.model_json_schema()["properties"]
    return properties


def _map_dir(folder: str | None) -> Path | None:
    if folder is not None and not Path(folder).is_dir():
        raise UserError(f"--map-dir: expected a folder of maps, got {folder!r}, which does not exist")
    return None if folder is None else Path(folder)
