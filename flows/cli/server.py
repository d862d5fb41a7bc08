"""The commands about Prefect's API that stays: `server status`, `server stop`."""

import typer

server = typer.Typer(
    help="Prefect's API that stays between calls, where VASTFLOW_SERVER_IDLE_S allows it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@server.command()
def status() -> None:
    """Say which servers stay."""
    from vastflow.tasks.prefect.kept_server import kept_servers

    found = kept_servers()
    for record in found:
        print(f"process {record.pid} at {record.url}")
    if not found:
        print("no server stays")


@server.command()
def stop() -> None:
    """End the servers that no campaign uses."""
    from vastflow.tasks.prefect.kept_server import end_kept

    found = end_kept()
    for record, ended in found:
        print(f"process {record.pid} at {record.url}: {'ended' if ended else 'a campaign uses it; it stays'}")
    if not found:
        print("no server stays")
