"""Workers before the first paced run: as many as this machine keeps in pace, by a probe."""

from dataclasses import replace

import pytest
from at_once import AtOnce
from table import each_row

from vastflow.sim.model.nodes import Nodes
from vastflow.sim.model.scenario import ProcessSetup, Scenario
from vastflow.sim.run import Execution, RunLog
from vastflow.tasks.engine import pace, work
from vastflow.tasks.engine.executor import WorkerDied
from vastflow.tasks.engine.pace import Pace, probe

PACED = Scenario("builtin:navigate_to_pose", 60.0, {}, {}, {}, programs=ProcessSetup(nodes=Nodes(time="paced")))


class Pool(AtOnce):
    """Answers probes by what a run takes."""

    def __init__(self, answer, workers):
        self.answer, self.workers, self.probes = answer, workers, []

    def called(self, function, *arguments):
        assert function is work.answered
        self.probes.append(arguments)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def bound(self, workers):
        self.workers = min(self.workers, workers)


@pytest.fixture
def kept(monkeypatch):
    """Keep pace twice on 4 cores, and return the pool and what was said."""
    monkeypatch.setattr(pace, "cores", lambda: 4)

    def keep(answer, workers=4, scenario=PACED):
        pool, said = Pool(answer, workers), []
        kept = Pace(pool, said.append)
        kept.keep(scenario, 7)
        kept.keep(scenario, 7)
        return pool, said

    return keep


@each_row(
    ("taken", "workers", "bound", "said"),
    [
        (0.8, 4, 3, "3 workers, as a paced run takes 0.8 of 4 cores"),
        (1.5, 8, 2, "2 workers, as a paced run takes 1.5 of 4 cores"),
        (3.0, 4, 1, "1 worker, as a paced run takes 3 of 4 cores"),
        (3.1, 4, 1, "1 worker, as a paced run takes 3.1 of 4 cores. Runs may be late, and are not judged then"),
        (0.1, 2, 2, "2 workers, as a paced run takes 0.1 of 4 cores"),
    ],
)
def test_workers_are_bounded_by_three_quarters_of_the_cores(kept, taken, workers, bound, said):
    pool, lines = kept(taken, workers)
    assert (pool.workers, lines) == (bound, [said])
    assert pool.probes == [(probe, PACED, 7)]


@each_row(
    ("scenario", "workers"),
    [
        (replace(PACED, programs=None), 4),
        (replace(PACED, programs=ProcessSetup()), 4),
        (replace(PACED, programs=ProcessSetup(nodes=Nodes())), 4),
        (PACED, 1),
    ],
)
def test_pace_probes_nothing_without_a_bound(kept, scenario, workers):
    pool, lines = kept(2.0, workers, scenario)
    assert (pool.workers, pool.probes, lines) == (workers, [], [])


@each_row("answer", [work.Broken("no python3"), WorkerDied("again")])
def test_probe_that_breaks_bounds_nothing(kept, answer):
    pool, lines = kept(answer)
    assert (pool.workers, len(pool.probes), lines) == (4, 1, [])


def test_probe_takes_ten_seconds_at_most(monkeypatch):
    asked = []

    def executed(scenario, run_index, seed):
        asked.append(
            (scenario.timeout_s, scenario.programs.nodes.most_late, scenario.programs.nodes.most_waiting, seed)
        )
        return Execution(None, RunLog(0.0, wall_s=4.0, cpu_s=6.0, max_rss_bytes=0))

    monkeypatch.setattr("vastflow.sim.run.execute", executed)
    assert probe(PACED, 7) == pytest.approx(1.5, abs=0.1)
    twice = replace(PACED, programs=ProcessSetup(nodes=Nodes(time="paced", real_time_factor=2.0)))
    probe(twice, 7)
    probe(replace(twice, timeout_s=5.0), 7)
    assert asked == [(10.0, 1.0, 1.0, 7), (20.0, 1.0, 1.0, 7), (5.0, 1.0, 1.0, 7)]
