"""The run logs of a campaign directory, by configuration."""

import json
from functools import cached_property
from pathlib import Path
from typing import Any

from vastflow.flows.results.campaign_tables import LOGS_FILE
from vastflow.sim.model.files import read_json


class KeptLogs:
    """Reads `logs/runs.jsonl`, or a file for each configuration as earlier versions wrote them.

    Reading raises `OSError` or `ValueError` where the file is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def of(self, configuration: str) -> list[dict[str, Any]]:
        """The log of each of a configuration's runs, in order, with the block's host and versions; empty without any."""
        own = self._directory / "logs" / f"{configuration}.json"
        if own.is_file():
            rows: list[dict[str, Any]] = read_json(own)
            return rows
        found: dict[int, dict[str, Any]] = {}
        for line in self._lines.get(configuration, ()):
            block = json.loads(line)
            where = {key: value for key, value in block.items() if key not in ("configuration", "runs")}
            found |= {row["run_index"]: {**row, **where} for row in block["runs"]}
        return [found[run_index] for run_index in sorted(found)]

    @cached_property
    def _lines(self) -> dict[str, list[bytes]]:
        """Configuration to the lines of its blocks."""
        found: dict[str, list[bytes]] = {}
        file = self._directory / LOGS_FILE
        if file.is_file():
            for line in file.read_bytes().splitlines():
                found.setdefault(json.loads(line)["configuration"], []).append(line)
        return found
