"""One call of a campaign without Prefect: keys, instantiation, and all stages in a worker of its own.

    python invalidation_child.py CAMPAIGN STORE [--python 3.12] [--version DISTRIBUTION=9.9] [--wait]

With `--wait` it says `keyed` when the keys are made, and goes on with the next line of its input. Prints what broke, as JSON.
"""

import argparse
import json
import platform
import sys
from pathlib import Path

from vastflow.flows.request.campaign_file import campaign_keys, read_campaign
from vastflow.flows.request.configurations import distinct_configurations
from vastflow.tasks.engine.engine import Engine
from vastflow.tasks.engine.evaluation import packed
from vastflow.tasks.engine.index import Index
from vastflow.tasks.engine.instantiation import Instantiator
from vastflow.tasks.engine.pool import Pool
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.keys import source
from vastflow.tasks.store.store import open_store


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("store", type=Path)
    parser.add_argument("--python")
    parser.add_argument("--version", default="")
    parser.add_argument("--wait", action="store_true")
    asked = parser.parse_args()
    if asked.python:
        platform.python_version_tuple = lambda: (*asked.python.split("."), "0")
    name, _, faked = asked.version.partition("=")
    real = source._version
    source._version = lambda distribution: faked if distribution == name else real(distribution)

    campaign, oracles = read_campaign(asked.campaign)
    store, tree = open_store(asked.store), source.installed_tree()
    keys = campaign_keys(tree, campaign.seed, oracles)
    pool = Pool(1, asked.store / "workers.log")
    engine = Engine(Index(store, keys), pool, Tally(), oracles)
    errors = {}

    def evaluator(requests):
        for request in requests:
            errors.update(engine.evaluate(packed(request.producer), request.evaluations).made)
        return errors

    if asked.wait:
        print("keyed", flush=True)
        sys.stdin.readline()
    found = Instantiator(campaign, store, keys, tree).instantiated(evaluator)
    configurations = distinct_configurations(found.instantiation, campaign.runs)
    try:
        engine.judge(configurations, engine.observe(configurations, engine.execute(configurations).made).made)
    finally:
        pool.close()
    print(json.dumps([*errors.values(), *(fault.error for fault in engine.faults)]))


if __name__ == "__main__":
    main()
