"""Reports of earlier calls in the user's cache folder, by all that they follow from.

After an edit of the campaign file that changes no result, such as a comment, a report is copied, and nothing is counted or drawn. After
another edit only figures are drawn that no earlier report has. They are not in the store, which others may write: a browser executes
what is in a page.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import platformdirs

from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.files import read_bytes, replace_file

MOST_KEPT: Final = 8
_CALLS_OWN: Final = frozenset({"campaign.vast", "metadata.json", "events.jsonl"})
_MADE: Final = ("evidence.json", "report.html", "runs_wide.parquet")
_LASTING: Final = "lasting.json"
_FIGURES: Final = "figures"


def kept_report_key(directory: Path, follows_from: str, rows: Sequence[str]) -> str:
    """Digest of a report without facts of the call.

    Args:
        directory: A campaign directory with its tables and nothing of the report.
        follows_from: Digest of code, oracles, inputs, and metadata.
        rows: Keys of all rows of the tables, which name the recordings and traces behind them.
    """
    tables = sorted(file for file in directory.glob("[!.]*") if file.is_file() and file.name not in _CALLS_OWN)
    digests = {file.name: file_digest(file) for file in tables}
    content = [follows_from, list(rows), digests, version("pandas")]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def copy_report(directory: Path, key: str) -> Mapping[str, Any] | None:
    """Write the report of a key into a campaign directory, and return its headline; None if it is not kept."""
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(_file(key)))) as archive:
            contents = {name: archive.read(name) for name in archive.namelist()}
        headline: Mapping[str, Any] = json.loads(contents.pop(_LASTING))["headline"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    (directory / _FIGURES).mkdir(exist_ok=True)
    for name, content in contents.items():
        (directory / name).write_bytes(content)
    return headline


def drawn_before(made_by: str) -> Callable[[str], Mapping[str, bytes] | None]:
    """Return a function from the key of a drawing to its files by suffix, None if it is new.

    Args:
        made_by: Digest of the code and the versions of libraries.
    """
    places: dict[str, tuple[Path, str]] = {}
    with suppress(OSError):
        for file in _reports():
            with suppress(OSError, ValueError, KeyError, zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
                lasting = json.loads(archive.read(_LASTING))
                if lasting["made_by"] == made_by:
                    places |= {key: (file, name) for key, name in lasting["drawn"].items()}

    def found(key: str) -> Mapping[str, bytes] | None:
        if key not in places:
            return None
        file, name = places[key]
        try:
            with zipfile.ZipFile(file) as archive:
                of = [each for each in archive.namelist() if Path(each).stem == name and each.startswith(_FIGURES)]
                return {Path(each).suffix[1:]: archive.read(each) for each in of}
        except (OSError, zipfile.BadZipFile):
            return None

    return found


def keep_report(directory: Path, key: str, made_by: str, headline: Mapping[str, Any], drawn: Mapping[str, str]) -> None:
    """Keep the report of a campaign directory, and the newest of the others; a failure costs time, nothing else.

    Args:
        drawn: Names of figures by the keys of what they show.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(_LASTING, json.dumps({"made_by": made_by, "headline": headline, "drawn": drawn}))
        for file in _files(directory):
            archive.write(file, file.relative_to(directory).as_posix())
    file = _file(key)
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, packed.getvalue())
        for old in _reports()[:-MOST_KEPT]:
            old.unlink()


def _files(directory: Path) -> Iterator[Path]:
    yield from (directory / name for name in _MADE)
    yield from sorted((directory / _FIGURES).iterdir())


def _reports() -> list[Path]:
    return sorted(_file("").parent.glob("*.zip"), key=lambda file: file.stat().st_mtime)


def _file(key: str) -> Path:
    return Path(platformdirs.user_cache_dir("vastflow"), "reports", f"{key}.zip")
