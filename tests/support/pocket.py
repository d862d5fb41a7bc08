"""A search for the pocket of times in which an oracle fails runs, computed without Prefect."""

import itertools
import math
from functools import partial

from vastflow.flows.request.run_request import request_of
from vastflow.flows.run import judged as judging
from vastflow.flows.run.event_log import open_log
from vastflow.flows.run.judged import read_store, run_batches, scan_store
from vastflow.flows.run.prepared import open_run
from vastflow.flows.run.reporting import write_campaign
from vastflow.tasks.engine.evaluation import packed

CAMPAIGN = """
version: 1
metadata: {name: pocket}
search:
  strategy: STRATEGY
  search_space:
    x: {type: float, low: 1, high: 11}
    n: {type: int, low: 0, high: 3}
  extract: {plugin: metrics, params: {badness: {oracle: own.py:Pocket, metric: badness}}}
  objectives: [{name: OBJECTIVE}]
  per_batch: 4
  confirm: 10
  seed: 1
MORE
constraints:
  - short: x < LIMIT
execution: {scenario_file: pocket.osc, runs: RUNS, timeout: 30}
evaluation:
  oracles:
    - own.py:Pocket: {}
"""
SCENARIO = """
import osc.helpers

scenario pocket:
    timeout(30s)
    x: time
    n: int
    do serial:
        wait elapsed(x)
"""
ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class Pocket(Oracle[Parameters]):
    \"\"\"Fails the oftener the nearer the run's time is to 7 s.\"\"\"

    Parameters = Parameters
    metrics = {"badness": "1"}

    def judge(self, trace, situation):
        run = trace.run.run_index
        if BROKEN:
            raise ZeroDivisionError("no verdict")
        badness = 1 - abs(trace.run.simulated_s - 7) / 10
        fails = (run * 0.618) % 1 < badness - 0.3
        return (self.failed(trace, "in the pocket", badness=badness) if fails else self.passed(trace, badness=badness))
"""
BATCHES = "  budget: [{batches: 3}]"


def file_of(place, more=BATCHES, strategy="random", runs="3", limit=12, broken="False", objective="failure_rate"):
    (place / "campaign" / "own.py").write_text(ORACLE.replace("BROKEN", broken))
    file = place / "campaign" / "pocket.vast"
    text = CAMPAIGN.replace("STRATEGY", strategy).replace("MORE", more).replace("RUNS", runs)
    file.write_text(text.replace("OBJECTIVE", objective).replace("LIMIT", str(limit)))
    return file


def computed(file, place, store, workers=2, calls=math.inf):
    """A campaign as the flow computes it, without Prefect; interrupted after so many calls of a stage."""
    numbers = itertools.count()

    def made(stage, *given):
        if next(numbers) >= calls:
            raise KeyboardInterrupt
        return stage(*given).made

    request = request_of(file, {"results": place / "results", "store": place / store, "workers": workers})
    with open_run(request) as (run, computing), open_log(run, computing) as log:
        engine = computing.engine

        def stages(_, shards):
            for shard in shards:
                recorded = made(engine.execute, shard.configurations)
                observed = made(engine.observe, shard.configurations, recorded)
                made(engine.judge, shard.configurations, observed)

        def completed(judged):
            if judged is None:
                instantiated = run.instantiator.instantiated(partial(evaluated, engine))
                judged = scan_store(run, computing, instantiated)
            return judging.compute_missing(judged, computing, stages)

        for _ in engine.attempts():
            return write_campaign(
                run, computing, run_batches(run, computing, read_store(run, computing), completed), log
            )


def evaluated(engine, requests):
    made = [engine.evaluate(packed(each.producer), each.evaluations).made for each in requests]
    return {key: error for errors in made for key, error in errors.items()}
