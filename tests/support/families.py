"""Families of configurations made in a line, instantiated without a file; and a small map on disk."""

from dataclasses import dataclass
from pathlib import Path

from vastflow.producers.campaign_file.sections import CARTESIAN
from vastflow.producers.constraints.constraint import Constraint
from vastflow.producers.constraints.expression import expression_of
from vastflow.producers.instantiation.instantiate import Family, instantiate
from vastflow.producers.model.producer import find_producer


def made(name, parameters, base=Path()):
    """Return the producer of a name with these parameters."""
    kind = find_producer(name, base)
    return kind(kind.Parameters.model_validate(parameters, context={"base": base}))


def levels(name, *values, **others):
    return made("ParameterVariationList", {"name": name, "values": list(values), **others})


def family(*producers, values=None, design=CARTESIAN, name="rooms", dimensions=None, **constraints):
    named = tuple(Constraint(key, expression_of(text)) for key, text in constraints.items())
    return Family(name, values or {}, dimensions or {}, producers, named, design)


@dataclass(frozen=True)
class Campaign:
    families: tuple[Family, ...]
    abstract: str = ""
    timeout_s: float = 60.0
    programs: None = None


def grown(*producers, **others):
    return instantiate(Campaign((family(*producers, **others),)))


def write_map(folder, name="room", columns=40, rows=20, origin=(0.0, 0.0), gray=None):
    """Write a map of 0.05 m cells, all free unless `gray` says otherwise."""
    folder.mkdir(exist_ok=True, parents=True)
    (folder / f"{name}.pgm").write_bytes(
        b"P5\n%d %d\n255\n" % (columns, rows) + (gray or bytes([254]) * columns * rows)
    )
    (folder / f"{name}.yaml").write_text(
        f"{{image: {name}.pgm, resolution: 0.05, origin: [{origin[0]}, {origin[1]}, 0.0]}}\n"
    )
