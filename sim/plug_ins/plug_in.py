"""Plug-ins: the code of others, entered so that whatever ends it is an error and nothing else."""

from collections.abc import Iterator
from contextlib import contextmanager

from vastflow.sim.plug_ins.effects import foreign_code


class PlugInExit(RuntimeError):
    """A plug-in tried to end the process, as `sys.exit` does."""


@contextmanager
def plug_in_code() -> Iterator[None]:
    """Run a plug-in's code in the body.

    `SystemExit` and its like pass by every `except Exception`, so that a plug-in's exit code would become vastflow's.

    Raises:
        PlugInExit: instead of what is raised and is no `Exception`; Ctrl-C stays what it is.
        EffectRefused: see `vastflow.sim.plug_ins.effects.foreign_code`.
    """
    try:
        with foreign_code():
            yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        code = f"({error.code!r})" if isinstance(error, SystemExit) else ""
        raise PlugInExit(f"its code raised {type(error).__name__}{code}, which would end vastflow") from error
