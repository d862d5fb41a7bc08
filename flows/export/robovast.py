"""Files of a campaign that RoboVAST's library reads beside the runs: execution, configurations, `campaign.db`, and `sysinfo.yaml`."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import PurePosixPath
from typing import Any, Final

import yaml

from vastflow.flows.export.format import ExportedCampaign, ExportedConfiguration, ExportedFile
from vastflow.sim.model.digest import digest

_TABLES: Final = """
CREATE TABLE campaign (id INTEGER PRIMARY KEY, name TEXT, mode TEXT, config_dir TEXT, config_json TEXT, created_at TEXT,
    strategy_state TEXT, stop_kind TEXT, stop_reason TEXT, batches INTEGER, elapsed_s REAL);
CREATE TABLE batch (id INTEGER PRIMARY KEY, campaign_id INTEGER, idx INTEGER, dir TEXT, created_at TEXT);
CREATE TABLE unit (id INTEGER PRIMARY KEY, batch_id INTEGER, paramset_id TEXT, config_name TEXT, params_json TEXT, objective REAL,
    objectives_json TEXT, measures_json TEXT, n_samples INTEGER, status TEXT, result_dir TEXT, created_at TEXT);
PRAGMA user_version = 1;
"""
"""RoboVAST 1.0's tables of a campaign's proposals and their results."""


def campaign_files(campaign: ExportedCampaign, runs: Mapping[str, Sequence[str | None]]) -> Iterator[ExportedFile]:
    """Yield the files about a whole campaign.

    Args:
        runs: Name of each configuration to the host of each of its runs, None if unknown.
    """
    metadata = campaign.metadata
    host = metadata.get("host", {})
    hosts = {each for row in runs.values() for each in row if each is not None}
    execution = {
        "execution_time": metadata.get("created"),
        "robovast_version": f"vastflow {metadata['vastflow']}" if "vastflow" in metadata else None,
        "runs": max(map(len, runs.values()), default=0),
        "execution_type": "local" if hosts <= {host.get("name")} else "cluster",
        "image": None,
        "image_revision": None,
        "cluster_info": {"node_count": len(hosts), "node_labels": None, "cpu_manager_policies": None},
    }
    yield "_execution/execution.yaml", _yaml(execution)
    configurations = {
        "vast": "campaign.vast",
        "created_at": metadata.get("created"),
        "configs": [_resolved(each, metadata) for each in campaign.configurations],
        "_run_files": [],
        "metadata": {"name": campaign.name},
    }
    yield "_transient/configurations.yaml", _yaml(configurations)
    yield "campaign.db", _database(campaign, runs)


def configuration_files(each: ExportedConfiguration, campaign: ExportedCampaign) -> Iterator[ExportedFile]:
    """Yield the files about a configuration, below its folder. A file is named by its place below the campaign's `_config`."""
    yield "_config/scenario.config", _yaml({each.scenario: plain(each.values)})
    family = {
        "block": digest([each.family, campaign.metadata.get("producers", {}).get(each.family, [])])[:12],
        "scenario_file": digest([each.scenario])[:12],
    }
    yield "_config/config.yaml", _yaml({"config_identifier": digest(family)[:12], "sub_identifier": family})


def system_info(own: Mapping[str, Any], campaign: Mapping[str, Any]) -> bytes:
    """Return `sysinfo.yaml` of a run from its host and the campaign's; what was not recorded is null.

    Args:
        own: The host of the run.
        campaign: The host of the campaign, which knows more of itself.
    """
    known = campaign if campaign.get("name") == own.get("name") else {}
    system = known.get("system")
    place = {
        "platform": system,
        "system": str(system).partition("-")[0] if system else None,
        "release": None,
        "version": None,
        "machine": own.get("machine"),
        "processor": None,
    }
    counts = {"available_cpus": known.get("cpus"), "available_mem": known.get("memory_bytes")}
    return _yaml({"platform": place, "cpu_name": None, "instance_type": None, **counts})


def plain(value: Any, before: str = "") -> Any:
    """Return `value` with paths of files as text behind `before`."""
    if isinstance(value, PurePosixPath):
        return f"{before}{value}"
    if isinstance(value, Mapping):
        return {key: plain(item, before) for key, item in value.items()}
    return [plain(item, before) for item in value] if isinstance(value, list) else value


def _resolved(each: ExportedConfiguration, metadata: Mapping[str, Any]) -> dict[str, Any]:
    producers = metadata.get("producers", {}).get(each.family, [])
    notes = {name: value for name, value in each.provenance.items() if name in ("_path_length", "_raster_points")}
    if "_path" in each.provenance:
        notes["_path"] = [dict(zip("xy", point, strict=False)) for point in each.provenance["_path"]]
    variations = [{"name": producer["name"]} for producer in producers]
    return {"name": each.name, "config": plain(each.values), "_config_files": [], "_variations": variations, **notes}


def _database(campaign: ExportedCampaign, runs: Mapping[str, Sequence[str | None]]) -> bytes:
    """Return `campaign.db`: the proposals of a search in its batches, else all configurations in one."""
    metadata, created = campaign.metadata, campaign.metadata.get("created")
    search, counts = metadata.get("search"), metadata.get("counts", {})
    told = campaign.evaluations or [
        {"configuration": each.name, "batch": 0, "point": json.dumps(plain(each.values), default=str)}
        for each in campaign.configurations
    ]
    batches = sorted({each["batch"] for each in told})
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(_TABLES)
        ended = (search or {}).get("ended_by")
        row = (1, campaign.name, "search" if search else "batch", "_config", json.dumps(search), created)
        beside = (None, ended, ended, len(batches), counts.get("wall_s"))
        database.execute(f"INSERT INTO campaign VALUES ({', '.join('?' * 11)})", (*row, *beside))
        known = [(index, 1, index, "", created) for index in batches]
        database.executemany("INSERT INTO batch VALUES (?, ?, ?, ?, ?)", known)
        for k, each in enumerate(told, 1):
            name, objective = each["configuration"], each.get("objective")
            objectives = json.dumps({} if search is None or objective is None else {search["objective"]: objective})
            found = (objective, objectives, each.get("measures", "{}"), len(runs.get(name, ())))
            status = each.get("standing", "done")
            unit = (k, each["batch"], name, name, each["point"], *found, status, name, created)
            database.execute(f"INSERT INTO unit VALUES ({', '.join('?' * 12)})", unit)
        database.commit()
        return database.serialize()


def _yaml(value: Any) -> bytes:
    text: str = yaml.safe_dump(value, sort_keys=False, allow_unicode=True)
    return text.encode(errors="replace")
