"""Sections of the report: a title, a summary, and the texts, figures, and tables below them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, Union

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
        key: Its anchor.
        link: Its name in the navigation.
        summary: Stands beside the title of a folded section.
        content: Texts, figures, and tables, in their order.
        folded: Whether it is hidden until a reader opens it.
    """

    key: str
    link: str
    title: str
    content: Sequence[Block]
    summary: str = ""
    folded: bool = True

    @property
    def pictures(self) -> list[Picture]:
        """All pictures of the content, in their order."""
        return list(_pictures(self.content))


def paragraph(text: str, *values: object) -> Markup:
    """A paragraph of HTML; `values` are escaped."""
    return Markup(f"<p>{text}</p>\n").format(*values)


def soft(text: str, *values: object) -> Markup:
    """A paragraph that explains what stands beside it."""
    return Markup(f'<p class="soft">{text}</p>\n').format(*values)


def heading(text: str) -> Markup:
    """A heading inside a section."""
    return Markup("<h3>{}</h3>\n").format(text)


def bullets(items: Iterable[object], style: str = "") -> Markup:
    """A list; items that are no markup are escaped."""
    rows = Markup("").join(Markup("<li>{}</li>\n").format(item) for item in items)
    return Markup("<ul{}>{}</ul>\n").format(Markup(' class="{}"').format(style) if style else "", rows)


def _pictures(content: Iterable[Block]) -> Iterator[Picture]:
    for block in content:
        if isinstance(block, Picture):
            yield block
        elif isinstance(block, Card):
            yield from () if block.picture is None else (block.picture,)
        elif isinstance(block, Group | Details):
            yield from _pictures(block.content)
