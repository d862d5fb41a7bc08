"""The commands about the store: `store info`, `store verify` and `store gc`."""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible
from vastflow.flows.terminal.options import AsJson, DryRun, command_group
from vastflow.flows.terminal.progress import bytes_text, count_text
from vastflow.sim.model.faults import UserError
from vastflow.tasks.store.artifact import redacted

if TYPE_CHECKING:
    from vastflow.tasks.store.store import Holding, Store

store = command_group("Inspect, verify, and clean the store, where results are cached.")

StoreOption = Annotated[
    str | None,
    typer.Option("--store", help="Store: a folder or an address (default: $VASTFLOW_STORE or the user's cache)."),
]


@store.command()
def info(place: StoreOption = None, as_json: AsJson = False) -> None:
    """Show what is in the store: artifacts, bytes, and age by stage."""
    with Interruptible("interrupted"):
        opened = _open(place, read_only=True)
        from vastflow.flows.results.cleaning import folder_bytes

        holdings = opened.holdings()
        names = ("environments", "prefect", "logs", "bundles", "results")
        local = {name: folder_bytes(opened.local / name) for name in names}
    found = _counted(holdings, time.time())
    if as_json:
        print(json.dumps({"store": redacted(opened.place), **found, "local": {"folder": str(opened.local), **local}}))
        return
    print(f"store: {redacted(opened.place)}\n")
    _print_stages(found)
    if found["unfinished"]:
        print(f"\n{count_text(found['unfinished'], 'artifact')} unfinished or without manifest")
    sizes = ", ".join(f"{name} {bytes_text(size)}" for name, size in local.items())
    print(f"\non this machine, in {opened.local}: {sizes}")


@store.command()
def verify(
    place: StoreOption = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Delete damaged artifacts, so that they are computed again.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compare every artifact with its manifest.

    Exit code 1 if damaged artifacts are left.
    """
    from concurrent.futures import ThreadPoolExecutor

    with Interruptible("Interrupted. Nothing more is discarded."), ThreadPoolExecutor(8) as readers:
        opened = _open(place, read_only=not repair)
        holdings = [holding for holding in opened.holdings() if holding.whole]
        keys = [holding.key for holding in holdings]
        faults = {key: fault for key, fault in zip(keys, readers.map(opened.fault, keys), strict=True) if fault}
        if repair:
            opened.remove(list(faults))
    if as_json:
        size = sum(holding.size_bytes for holding in holdings)
        said = {"artifacts": len(holdings), "bytes": size, "damaged": faults, "repaired": repair}
        print(json.dumps({"store": redacted(opened.place), **said}))
    else:
        for key, fault in faults.items():
            print(f"{key}: {fault}")
        discarded = ", deleted to be computed again" if repair and faults else ""
        print(f"{count_text(len(holdings), 'artifact')} read, {len(faults)} damaged{discarded}")
    if faults and not repair:
        raise typer.Exit(1)


@store.command()
def gc(
    keep: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RESULTS",
            help="Campaign directory, or folder of them, whose artifacts are kept (may be repeated).",
        ),
    ] = None,
    older_than: Annotated[
        int | None, typer.Option(metavar="DAYS", min=1, help="Delete only artifacts that are older (default: 1).")
    ] = None,
    dry_run: DryRun = False,
    place: StoreOption = None,
    as_json: AsJson = False,
) -> None:
    """Delete artifacts that no kept campaign directory needs.

    Artifacts younger than a day always stay: a campaign may be writing them.
    """
    if not keep and older_than is None:
        raise UserError("store gc: expected --keep, --older-than, or both, got neither")
    directories = []
    for folder in keep or []:
        inside = sorted(file.parent for file in folder.glob("[!.]*/metadata.json"))
        if not inside or (folder / "metadata.json").exists():
            check_directory(folder, "--keep")
            inside = [folder]
        directories += inside
    with Interruptible("Interrupted. Deleted artifacts are computed again when they are needed."):
        opened = _open(place, read_only=dry_run)
        from vastflow.flows.results.cleaning import DAY_S, clean, cleaning, references

        opened.refresh()
        referred = references(opened, directories) if directories else None
        chosen = cleaning(opened, referred, (older_than or 1) * DAY_S)
        if not dry_run:
            clean(opened, chosen)
    removed = _counted(chosen.removed, time.time())
    kept_bytes = sum(holding.size_bytes for holding in chosen.kept)
    if as_json:
        counts = {name: removed[name] for name in ("artifacts", "bytes")}
        counts |= {"environments": len(chosen.environments), "environments_bytes": chosen.environments_bytes}
        counts |= {"kept": len(chosen.kept), "kept_bytes": kept_bytes}
        keys = [holding.key for holding in chosen.removed]
        print(json.dumps({"store": redacted(opened.place), "deleted": not dry_run, **counts, "keys": keys}))
        return
    _print_stages(removed)
    if chosen.environments:
        print(f"and {len(chosen.environments)} environments of {bytes_text(chosen.environments_bytes)}")
    verb = "would be deleted" if dry_run else "deleted"
    print(f"\n{count_text(len(chosen.removed), 'artifact')} {verb}, {len(chosen.kept)} kept ({bytes_text(kept_bytes)})")


def _counted(holdings: "Sequence[Holding]", now_s: float) -> dict[str, Any]:
    from vastflow.tasks.store.store import STAGES

    whole = [holding for holding in holdings if holding.whole]
    by_stage = {stage: [holding for holding in whole if holding.stage == stage] for stage in STAGES}

    def sums(some: "Sequence[Holding]") -> dict[str, Any]:
        ages = [round(max(0.0, now_s - holding.written_s) / 86400, 4) for holding in some]
        size = sum(holding.size_bytes for holding in some)
        oldest, newest = max(ages, default=None), min(ages, default=None)
        return {"artifacts": len(some), "bytes": size, "oldest_days": oldest, "newest_days": newest}

    stages = {stage: sums(some) for stage, some in by_stage.items()}
    return {**sums(whole), "unfinished": len(holdings) - len(whole), "stages": stages}


def _print_stages(found: dict[str, Any]) -> None:
    from vastflow.flows.terminal.display import print_rows, terminal_table

    rows = []
    for name, row in [*found["stages"].items(), ("all", found)]:
        ages = (_age_text(row["oldest_days"]), _age_text(row["newest_days"]))
        rows.append((name, f"{row['artifacts']:,}", bytes_text(row["bytes"]), *ages))
    print_rows([terminal_table(("stage",), ("artifacts", "size", "oldest", "newest"), rows=rows)])


def _age_text(days: float | None) -> str:
    if days is None:
        return "–"
    for number, unit in ((days, "d"), (days * 24, "h"), (days * 24 * 60, "min")):
        if number >= 1:
            return f"{number:.0f} {unit}"
    return "< 1 min"


def _open(place: str | None, *, read_only: bool) -> "Store":
    from vastflow.tasks.store.store import open_store, store_address, store_root

    if store_address(place) is None and not (root := store_root(place)).is_dir():
        raise UserError(
            f"store: expected a folder that `vastflow run` has used, got {str(root)!r}, which does not exist"
        )
    return open_store(place, read_only=read_only)
