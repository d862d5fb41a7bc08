"""Write a whole campaign directory from artifacts, for tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from vastflow.flows.request.campaign_file import campaign_keys, campaign_name, read_campaign
from vastflow.flows.request.run_request import Asked
from vastflow.flows.results import results
from vastflow.flows.results.directory import new_directory
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.provenance import ingredients_row
from vastflow.flows.results.summary import Results, Work
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys


@dataclass(frozen=True, slots=True)
class ConfigurationResult:
    """A `vastflow.flows.results.rows.StoredResult` of values."""

    recordings: Sequence[bytes] = ()
    traces: Sequence[bytes] = ()
    verdicts: Sequence[Verdict] = ()
    faults: Sequence[RunFault] = ()
    behaviors: Sequence[bytes] = ()
    outputs: Sequence[bytes] = ()
    logs: Sequence[bytes] = ()
    exact: bool = False
    causes: Mapping[int, str] = field(default_factory=dict)
    identity: None = None


KEYS = Keys("x86_64; glibc 2.36; avx2 fma; ", "e" * 64, "o" * 64, "j" * 64, 0, [])
CREATED = datetime(2026, 11, 21, 6, 5, 4)
WORK = Work(executed=3, reused=1, simulated_s=30.0, cpu_s=2.0, wall_s=1.5)


def write_results(path, root, found, *, map_dir=None, runs=2, tree=None, asked=(), **named) -> Results:
    """Write the directory `root/<name>-<time>/` of a campaign file; it appears whole or not at all.

    Args:
        found: Results of each configuration, or a function that gives those of one.
        tree: The source that makes keys and ingredients; by default keys are `KEYS`, and ingredients are left out.
        asked: Entries of `metadata.json` on the request, beside file and runs.
        named: Other arguments of `results.write_results` than the usual ones.
    """
    campaign, oracles = read_campaign(path, map_dir)
    inputs = inputs_of(campaign, oracles)
    instantiation = named.get("instantiation") or instantiate(campaign)
    named["runs"] = {each.name: runs for each in instantiation.configurations}
    record = {}
    if tree is not None:
        request = Asked(campaign.path.name, runs, (), inputs.places).as_json() | dict(asked)
        record = {"asked": request, **ingredients_row(tree, campaign.families, oracles)}
    usual = {
        "instantiation": instantiation,
        "found": found if callable(found) else lambda configuration: found,
        "oracles": [oracle.name for oracle in oracles],
        "keys": KEYS if tree is None else campaign_keys(tree, campaign.seed, oracles),
        "record": record,
        "work": lambda: WORK,
        "report": lambda place: None,
    }
    created = named.setdefault("created", CREATED)
    with new_directory(root, campaign_name(campaign), created) as directory, directory.writing():
        return results.write_results(directory, campaign, inputs, **{**usual, **named})
