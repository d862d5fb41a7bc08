"""Worlds of bodies: a JSON file of discs, boxes, and polygons."""

from pathlib import Path
from typing import ClassVar, Final

from pydantic import TypeAdapter, ValidationError

from vastflow.sim.model.files import read_bytes
from vastflow.sim.world.bodies import Body
from vastflow.sim.world.readers.reader import WorldError

BODIES: Final = TypeAdapter(tuple[Body, ...])


class BodyList:
    """Reader of lists of bodies in JSON."""

    suffixes: ClassVar[tuple[str, ...]] = (".bodies.json",)

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path]

    @staticmethod
    def read(path: Path) -> tuple[Body, ...]:
        try:
            return BODIES.validate_json(read_bytes(path, "a list of bodies"))
        except ValidationError as error:
            first = error.errors()[0]
            place = "".join(f"[{part!r}]" for part in first["loc"])
            raise WorldError(f"{path}: {place}: expected bodies, got one where {first['msg']}") from None
