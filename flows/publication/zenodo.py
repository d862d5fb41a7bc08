"""Drafts by InvenioRDM's API, as Zenodo has it: a description, a reserved DOI, and the archive. Nothing is published."""

import hashlib
import html
import json
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final
from urllib.parse import quote, urlsplit

import httpx

from vastflow.flows.publication.about import About, Author
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import Unreadable, json_value, open_file

ZENODO: Final = "https://zenodo.org"
TOKEN: Final = "ZENODO_ACCESS_TOKEN"
SILENT_S = 120.0
"""Most seconds without a byte of an answer."""
MOST_WAIT_S: Final = 300.0
"""Most seconds that a server may ask to wait by 429, for each request."""
_MOST_BYTES: Final = 2**24
_ADDRESS: Final = re.compile(r"(https?://(?:[\w.-]+|\[[\da-f:]+\])(?::\d{1,5})?)(?:/uploads/([\w-]+))?/?", re.ASCII)
_REASONS: Final = {
    401: f"expected a token of this server in {TOKEN}",
    403: f"expected a token with the scope deposit:write in {TOKEN}, and a draft of your own",
    404: "expected a draft of your own that is not published",
    413: "expected a smaller file",
}


class Deposit:
    """A draft at a server, which is described and gets its archive; raises `UserError` for whatever is refused."""

    def __init__(self, address: str, token: str) -> None:
        """Check the address of a server or of a draft, and the token, which goes to that server alone."""
        found, self._token = _ADDRESS.fullmatch(address), token.strip()
        host = found and urlsplit(found[1]).hostname
        is_remote = address.startswith("https:")
        if found is None or not (is_remote or host in ("localhost", "127.0.0.1", "::1")):
            right = f"an address such as https://sandbox.zenodo.org, or of a draft such as {ZENODO}/uploads/123"
            raise UserError(f"--zenodo-at: expected {right}, got {address.rpartition('@')[2]!r:.100}")
        self._server, self._host, self._draft = found[1], str(host), found[2] or ""
        if not re.fullmatch("[!-~]+", self._token):
            raise UserError(f"{TOKEN}: expected a token of {self._server} with the scope deposit:write, got none")
        headers = {"Authorization": f"Bearer {self._token}", "Accept": "application/json"}
        # A proxy of the environment has no business with a server on this machine.
        self._client = httpx.Client(headers=headers, timeout=SILENT_S, follow_redirects=False, trust_env=is_remote)

    @property
    def address(self) -> str:
        """Address of the draft, or of the server while there is none."""
        return f"{self._server}/uploads/{self._draft}" if self._draft else self._server

    def describe(self, about: About) -> tuple[str, list[str]]:
        """Make or describe the draft; return its reserved DOI and faults of the description."""
        body = {"access": {"record": "public", "files": "public"}, "files": {"enabled": True}}
        metadata = metadata_of(about, self._host)
        if self._draft:
            now = self._ask("GET", "")
            # A server may take a description without `pids` as one without a DOI: the reserved one would be lost beyond repair.
            body |= {key: now[key] for key in ("access", "custom_fields", "pids") if key in now}
            answer = self._ask("PUT", "", {**body, "metadata": {**_by_id(now.get("metadata")), **metadata}})
        else:
            answer = self._ask("POST", None, {**body, "metadata": metadata})
            self._draft = str(answer.get("id"))
            if not re.fullmatch(r"[\w-]+", self._draft, re.ASCII):
                raise UserError(f"{self._server}: expected the id of a draft, got {self._draft!r:.60}")
        return _doi(answer) or _doi(self._ask("POST", "/pids/doi")), self._faults(answer)

    def upload(self, archive: Path) -> None:
        """Upload an archive in place of the file of its name, and compare what the server has of it."""
        place, entries = f"/files/{quote(archive.name, safe='')}", self._ask("GET", "/files").get("entries")
        if archive.name in [_object(each).get("key") for each in _list(entries)]:
            self._ask("DELETE", place)
        with open_file(archive, "an archive") as file:
            md5 = hashlib.file_digest(file, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
            right = f"md5:{md5}", file.tell()
            self._ask("POST", "/files", [{"key": archive.name}])
            self._ask("PUT", f"{place}/content", file=file)
        there = self._ask("POST", f"{place}/commit")
        if (got := (there.get("checksum"), there.get("size"))) != right:
            raise UserError(
                f"{self._server}: expected {right[0]} of {right[1]} bytes, got {got[0]!r:.60} of {got[1]!r:.60}"
            )

    def _ask(
        self, method: str, place: str | None, value: object = None, file: IO[bytes] | None = None
    ) -> dict[str, Any]:
        """Return the answer to a request; `place` is below the draft, None for the drafts themselves."""
        below, left_s = "" if place is None else f"/{self._draft}/draft{place}", MOST_WAIT_S
        while True:
            status, headers, content = self._answer(method, f"{self._server}/api/records{below}", value, file)
            wait_s = _wait_s(headers)
            if status != 429 or wait_s > left_s:
                break
            time.sleep(wait_s)
            left_s -= wait_s
        answer: Any = None
        with suppress(Unreadable):
            answer = json_value(content) if content else {}
        if 200 <= status < 300 and isinstance(answer, dict):
            return answer
        own = {429: f"it asks to wait {wait_s:.0f} s", **dict.fromkeys(range(200, 300), "expected a JSON object")}
        own |= dict.fromkeys(range(300, 400), "expected no redirect, which is not followed")
        said = [*self._faults(_object(answer)), self._plain(_object(answer).get("message") or "")]
        why = ", ".join(filter(None, [{**own, **_REASONS}.get(status, ""), *said])) or "no reason"
        raise UserError(f"{self._server}: {method} /api/records{below} was answered by {status}: {why:.600}")

    def _answer(
        self, method: str, address: str, value: object, file: IO[bytes] | None
    ) -> tuple[int, Mapping[str, str], bytes]:
        sent: dict[str, Any] = {} if value is None else {"json": value}
        if file is not None:  # httpx sends its length, and its content in parts
            file.seek(0)
            sent = {"content": file, "headers": {"Content-Type": "application/octet-stream"}}
        content = b""
        try:
            with self._client.stream(method, address, **sent) as answer:
                for part in answer.iter_bytes():
                    if len(content := content + part) > _MOST_BYTES:
                        raise UserError(f"{self._server}: expected an answer of at most {_MOST_BYTES:,} bytes")
        except (httpx.HTTPError, httpx.InvalidURL, ValueError, OverflowError) as error:
            is_late = isinstance(error, httpx.TimeoutException)
            raise UserError(
                f"{self._server}: no answer{f' in {SILENT_S:.0f} s' if is_late else f': {error}'}"
            ) from None
        return answer.status_code, answer.headers, content

    def _faults(self, answer: Mapping[str, Any]) -> list[str]:
        errors = map(_object, _list(answer.get("errors")))
        said = [f"{each.get('field')}: {' '.join(map(str, _list(each.get('messages'))))}" for each in errors]
        return [self._plain(each) for each in said]

    def _plain(self, said: object) -> str:
        """Return a server's words without the token, and without what moves a terminal's cursor."""
        words = "".join(each if each.isprintable() else " " for each in str(said).replace(self._token, "…"))
        return " ".join(words.split())[:300]


def metadata_of(about: About, host: str) -> dict[str, Any]:
    """Return a description as InvenioRDM has it; the host is the publisher where none is named."""
    return {
        "resource_type": {"id": "dataset"},
        "title": about.title,
        "publication_date": about.published,
        "creators": [_creator(each) for each in about.authors],
        "publisher": about.publisher or ("Zenodo" if host.endswith("zenodo.org") else host),
        "description": f"<p>{html.escape(about.description)}</p>".replace("\n", "<br>"),
        "rights": [{"id": about.license.lower()} if about.is_one_license else {"title": {"en": about.license}}],
        "subjects": [{"subject": each} for each in about.keywords if each],
        **({"version": about.version} if about.version else {}),
    }


def _creator(author: Author) -> dict[str, Any]:
    family, _, given = (part.strip() for part in author.name.partition(","))
    person = {"type": "personal", "family_name": family, "given_name": given}
    identifiers = [{"scheme": "orcid", "identifier": author.orcid}] if author.orcid else []
    called = person if author.is_person else {"type": "organizational", "name": author.name}
    affiliations = [{"name": author.affiliation}] if author.affiliation else []
    return {"person_or_org": {**called, "identifiers": identifiers}, "affiliations": affiliations}


def _by_id(metadata: object) -> dict[str, Any]:
    """Return what a server has with entries of vocabularies by id alone: it refuses the titles that it adds itself."""
    return _object(
        json.loads(json.dumps(metadata), object_hook=lambda each: {"id": each["id"]} if "id" in each else each)
    )


def _object(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _doi(answer: Mapping[str, Any]) -> str:
    found = str(_object(_object(answer.get("pids")).get("doi")).get("identifier"))
    return found if re.fullmatch(r"10\.[!-~]+", found) else ""


def _wait_s(headers: Mapping[str, str]) -> float:
    """Return the seconds that an answer asks to wait, at least 1."""
    for name, since in (("retry-after", 0.0), ("x-ratelimit-reset", time.time())):
        with suppress(KeyError, ValueError):
            return max(1.0, float(headers[name]) - since)
    return 1.0
