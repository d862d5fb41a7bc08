"""The description of a publication: title, license, and authors, from options, the campaign file, or the terminal."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression

from vastflow.oracles.results.unusable import reading
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_json, read_text, yaml_value

_ORCID: Final = re.compile(r"(?:https?://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dXx])")
_LIKE_ORCID: Final = re.compile(r"(?:https?://orcid\.org/)?[\dXx -]{15,24}")


@dataclass(frozen=True, slots=True)
class Author:
    """A person as `Family, Given`, or an organization; ORCID and affiliation may be empty."""

    name: str
    orcid: str = ""
    affiliation: str = ""

    @property
    def iri(self) -> str:
        """Identifier in crate and provenance."""
        return f"https://orcid.org/{self.orcid}" if self.orcid else f"#{re.sub('[^A-Za-z0-9]+', '-', self.name)}"

    @property
    def is_person(self) -> bool:
        """Whether the name is `Family, Given`, or has an ORCID."""
        return bool(self.orcid) or "," in self.name


@dataclass(frozen=True)
class About:
    """The description of a publication: `license` is an SPDX expression, `published` a day in ISO 8601."""

    title: str
    description: str
    license: str
    authors: Sequence[Author]
    keywords: Sequence[str]
    published: str
    version: str = ""
    publisher: str = ""

    @property
    def is_one_license(self) -> bool:
        """Whether the license is a name of SPDX's list, and no expression of several."""
        return self.license.replace("-", "").replace(".", "").isalnum() and not self.license.startswith("LicenseRef-")


def orcid_of(text: str, where: str) -> str:
    """Return an ORCID without its address; raises `UserError` for another text or check digit (ISO 7064, MOD 11-2)."""
    if (found := _ORCID.fullmatch(text.strip())) is None:
        raise UserError(f"{where}: expected an ORCID such as 0000-0002-1825-0097, got {text!r:.60}")
    orcid, total = found[1].upper(), 0
    for digit in orcid.replace("-", "")[:-1]:
        total = (total + int(digit)) * 2
    if (check := "0123456789X"[(12 - total % 11) % 11]) != orcid[-1]:
        raise UserError(f"{where}: expected an ORCID with check digit {check}, got {orcid}")
    return orcid


def author_of(said: Any, where: str = "--author") -> Author:
    """Read `Family, Given; ORCID; affiliation`, of which the name alone is needed, or an entry of RoboVAST's `metadata.creators`."""
    if isinstance(said, dict):
        own = said.get("identifiers") or ""
        own = own[0] if isinstance(own, list) else own
        own = str(own.get("orcid") or own.get("identifier") or "") if isinstance(own, dict) else str(own)
        name, orcids, affiliations = str(said.get("name") or ""), [own] if own else [], [said.get("affiliation") or ""]
    else:
        name, *others = (part.strip() for part in str(said).split(";"))
        orcids = [part for part in others if _LIKE_ORCID.fullmatch(part)]
        affiliations = [part for part in others if part and part not in orcids]
    if not name or len(orcids) > 1 or len(affiliations) > 1:
        raise UserError(f"{where}: expected a name, one ORCID, and one affiliation, got {said!r:.100}")
    return Author(name, orcid_of(orcids[0], where) if orcids else "", "".join(map(str, affiliations)))


def about_of(
    directory: Path, options: Mapping[str, str], authors: Sequence[str], ask: Callable[[str], str] | None = None
) -> About:
    """Return the description of a publication.

    Args:
        options: `title`, `description`, `license`, and `date`; empty ones are taken from the campaign file.
        authors: As `author_of` reads them, in place of `metadata.creators`.
        ask: Asks the user for what is missing; None if nobody can be asked.

    Raises:
        UserError: something is missing or wrong, or the directory is damaged.
    """
    with reading(directory):
        metadata = read_json(directory / "metadata.json")
        said = (yaml_value(read_text(directory / "campaign.vast")) or {}).get("metadata") or {}
        name, day = str(metadata["name"]), options["date"] or str(metadata["created"])[:10]
        found = {key: str(said.get(key) or "") for key in ("title", "description", "license", "version", "publisher")}
        found |= {key: value for key, value in options.items() if value}
        words, creators = said.get("keywords") or (), said.get("creators") or []
    people = [author_of(each) for each in authors] or [
        author_of(each, f"campaign.vast: metadata.creators[{k}]")
        for k, each in enumerate(creators if isinstance(creators, list) else [creators])
    ]
    if ask is not None:
        found["license"] = found["license"] or ask("License of the results (SPDX, such as CC-BY-4.0)")
        people = people or [author_of(ask("Author, as 'Family, Given; ORCID; affiliation'"), "author")]
    if not found["license"] or not people:
        lack, key = ("author", "creators") if found["license"] else ("license", "license")
        raise UserError(f"no {lack}: Name one by --{lack}, or by metadata.{key} in the campaign file.")
    try:
        return About(
            title=found["title"] or name,
            description=found["description"] or f"Results of the campaign {name}.",
            license=canonicalize_license_expression(found["license"]),
            authors=people,
            keywords=[each.strip() for each in (words.split(",") if isinstance(words, str) else map(str, words))],
            published=date.fromisoformat(day).isoformat(),
            version=found["version"],
            publisher=found["publisher"],
        )
    except InvalidLicenseExpression:
        raise UserError(f"license: expected SPDX such as CC-BY-4.0, got {found['license']!r:.60}") from None
    except ValueError:
        raise UserError(f"--date: expected a day such as 2026-01-31, got {day!r:.60}") from None
