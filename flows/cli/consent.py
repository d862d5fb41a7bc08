"""Consent of a user to code of others in a campaign directory, once for each."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from vastflow.sim.model.faults import UserError

Trust: TypeAlias = Annotated[
    bool, typer.Option("--trust", help="Execute code in RESULTS that you did not make, now and from now on.")
]


@contextmanager
def executing(directory: Path, trust: bool, *, code: bool = True, called: Path | None = None) -> Iterator[None]:
    """Let the body execute code of a campaign directory that the user made or permits, and no other.

    Args:
        trust: Permission without a question.
        code: False if the body needs no code of the directory.
        called: What the user named, where the directory is a copy of it.

    Raises:
        NotPermitted: the user does not permit it, or nobody can be asked.
    """
    from vastflow.flows.results.trust import NotPermitted, permitted_contents
    from vastflow.sim.plug_ins.loading import code_from

    contents: frozenset[str] = frozenset()
    try:
        contents = permitted_contents(directory, "" if trust else None) if code else contents
    except NotPermitted as error:
        asked = replace(error.code, directory=str(called or directory))
        if not (sys.stdin.isatty() and sys.stderr.isatty()):
            raise NotPermitted(asked) from None
        if not typer.confirm(f"{asked}\nExecute it, now and from now on?", err=True):
            raise UserError(f"{called or directory}: nothing was executed") from None
        contents = permitted_contents(directory, error.code.digest)
    with code_from(contents):
        yield
