"""The command `publish`: a campaign directory as one archive that others verify."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vastflow.flows.results.address import check_directory
from vastflow.flows.terminal.ending import Interruptible, writing
from vastflow.flows.terminal.options import DryRun, ResultsFolder
from vastflow.sim.model.faults import UserError

if TYPE_CHECKING:
    from vastflow.flows.publication.about import About
    from vastflow.flows.publication.zenodo import Deposit


def publish(
    results: ResultsFolder,
    archive: Annotated[Path, typer.Argument(metavar="ARCHIVE", help="A new file, such as office.zip.")],
    without: Annotated[
        str, typer.Option(metavar="PARTS", help="Leave out parts, such as traces,figures; sizes are shown first.")
    ] = "",
    title: Annotated[str, typer.Option(help="Title (default: metadata.title, or the campaign's name).")] = "",
    description: Annotated[str, typer.Option(help="What the results are about (default: metadata.description).")] = "",
    terms: Annotated[
        str, typer.Option("--license", metavar="SPDX", help="License, such as CC-BY-4.0 (default: metadata.license).")
    ] = "",
    author: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AUTHOR",
            help="'Family, Given; ORCID; affiliation' (may be repeated; default: metadata.creators).",
        ),
    ] = None,
    date: Annotated[str, typer.Option(metavar="DAY", help="Day of publication (default: the campaign's).")] = "",
    public: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Inputs that are public (may be repeated).")
    ] = None,
    private: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Inputs to leave out (may be repeated).")
    ] = None,
    allow_opaque: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Opaque inputs to publish all the same (may be repeated)."),
    ] = None,
    zenodo: Annotated[
        bool,
        typer.Option("--zenodo", help="Make a draft at Zenodo with the archive and a DOI; needs ZENODO_ACCESS_TOKEN."),
    ] = False,
    zenodo_at: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Make it at another server of InvenioRDM, or go on with this draft.")
    ] = "",
    dry_run: DryRun = False,
) -> None:
    """Publish a campaign as one archive.

    Checksums (BagIt), a description for programs (RO-Crate), the provenance of every artifact (PROV), and a data card. `vastflow
    verify` checks it elsewhere.
    """
    check_directory(results)
    deposit = None
    if zenodo or zenodo_at:
        from vastflow.flows.publication.zenodo import TOKEN, ZENODO, Deposit

        deposit = Deposit(zenodo_at or ZENODO, os.environ.get(TOKEN, ""))
    elif archive.exists():
        raise UserError(f"{archive}: expected a new file, got one that exists")
    with Interruptible(f"Interrupted. {archive} was not written."):
        from vastflow.flows.publication.about import about_of
        from vastflow.flows.publication.card import sizes_of
        from vastflow.flows.publication.contents import contents_of, inputs_of, refuse_opaque
        from vastflow.flows.publication.publish import write_publication
        from vastflow.flows.terminal.display import print_rows, terminal_table

        inputs = inputs_of(results, {"public": public or (), "private": private or ()})
        contents = contents_of(results, inputs, [each.strip() for each in without.split(",") if each.strip()])
        print_rows([terminal_table(("part",), ("files", "size"), rows=sizes_of(contents))])
        for each in inputs:
            if each.kind != "public":
                print(f"{each.kind}: {each.name}{f' ({each.reason})' if each.reason else ''}")
        for name, reason in contents.left_out.items():
            print(f"left out: {name} ({reason})")
        refuse_opaque(inputs, allow_opaque or ())
        is_asked = sys.stdin.isatty() and sys.stderr.isatty()
        options = {"title": title, "description": description, "license": terms, "date": date}
        about = about_of(results, options, author or (), _ask if is_asked else None)
        if dry_run:
            return
        with writing(archive):
            words = write_publication(contents, about, archive)
        print(f"{words}\nwritten: {archive}. Check it by `vastflow verify {archive}`.")
    if deposit is not None:
        with Interruptible(f"Interrupted. {archive} stays. A draft that is named above may lack it."):
            _deposit(deposit, about, archive)


def _deposit(deposit: "Deposit", about: "About", archive: Path) -> None:
    try:
        doi, faults = deposit.describe(about)
        print(f"draft: {deposit.address}, DOI {doi or 'none'}")
        for fault in faults:
            print(f"complete it there: {fault}")
        deposit.upload(archive)
    except UserError as error:
        right = f"Repeat the command with --zenodo-at {deposit.address}"
        raise UserError(f"{str(error).rstrip('.')}. {archive} stays, but is not uploaded: {right}.") from None
    print(f"uploaded: {archive}. Nothing is published: Publish the draft there, or discard it.")


def _ask(words: str) -> str:
    answer: str = typer.prompt(words, err=True)
    return answer
