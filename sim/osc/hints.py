"""What to write in place of a type that is not known."""

from collections.abc import Collection

from vastflow.sim.osc.faults import did_you_mean, nearest


def right_type(name: str, known: Collection[str]) -> str:
    """The library to import for a type, the nearest name among those that are known or in any library, or all known."""
    from vastflow.sim.osc.libraries import home_of, library, library_names  # they are checked with what asks here

    if home := home_of(name):
        return f"'import {home}', which declares it"
    if nearest(name, known) is None:
        elsewhere = {type_name for library_name in library_names() for type_name in library(library_name).type_names()}
        if near := nearest(name, elsewhere):
            return f"did you mean {near!r} of {home_of(near)}?"
    return did_you_mean(name, known)
