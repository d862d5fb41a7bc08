"""Sections of the report: a title, a summary, and the texts, figures, and tables below them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, Union

from markupsafe import Markup

from vastflow.oracles.page.pictures import Picture
from vastflow.oracles.page.table import Table

Block: TypeAlias = Union[Markup, Picture, Table, "Card", "Group", "Details"]


@dataclass(frozen=True, eq=False)
class Card:
    """A picture with text beside it."""

    title: str
    text: Markup
    picture: Picture | None


@dataclass(frozen=True, eq=False)
class Group:
    """Blocks beside each other, as the style sheet arranges the class `style`."""

    style: str
    content: Sequence[Block]


@dataclass(frozen=True, eq=False)
class Details:
    """Blocks that are hidden until a reader opens them."""

    summary: str
    content: Sequence[Block]
    open: bool = False


@dataclass(frozen=True, eq=False)
class Section:
    """A section of the page.

    Attributes:
        key: Its anchor, and the name of its text in the template.
        link: Its name in the navigation.
        summary: Text beside the title of a folded section.
        content: Texts, figures, and tables below its text.
        folded: Whether it is hidden until opened.
        values, figures: Values and figures of the text in the template.
    """

    key: str
    link: str
    title: str
    summary: str = ""
    content: Sequence[Block] = ()
    folded: bool = True
    values: Mapping[str, Any] = field(default_factory=dict)
    figures: Sequence[Picture] = ()

    @property
    def pictures(self) -> list[Picture]:
        """All of its pictures, in their order."""
        return [*self.figures, *_pictures(self.content)]


def paragraph(text: str, *values: object) -> Markup:
    """A paragraph of HTML; `values` are escaped."""
    return Markup(f"<p>{text}</p>\n").format(*values)


def soft(text: str, *values: object) -> Markup:
    """A paragraph that explains what stands beside it."""
    return Markup(f'<p class="soft">{text}</p>\n').format(*values)


def heading(text: str) -> Markup:
    """A heading inside a section."""
    return Markup("<h3>{}</h3>\n").format(text)


def _pictures(content: Iterable[Block]) -> Iterator[Picture]:
    for block in content:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Card):
            yield from () if block.picture is None else (block.picture,)
        elif isinstance(block, Group | Details):
            yield from _pictures(block.content)
