import threading
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from vastflow.tasks.engine.progress import Progress, Reporter, Tally


def tally():
    made = Tally()
    made.expect({"room-1": 2, "room-2": 2})
    return made


WANTED = {"a": 3, "b": 1, "c": 2}
CONFIGURATIONS = st.sampled_from([*WANTED, "unknown"])
INDICES = st.integers(0, 4)
TOLD = st.one_of(
    st.tuples(st.just("reuse"), CONFIGURATIONS, st.one_of(st.builds(range, INDICES, INDICES), st.lists(INDICES))),
    st.tuples(st.just("execute"), CONFIGURATIONS, st.dictionaries(INDICES, st.sampled_from([0.5, 1.0, 8.0]))),
    st.tuples(
        st.just("judge"), CONFIGURATIONS, st.dictionaries(INDICES, st.sampled_from(["pass", "fail", "not judged"]))
    ),
)


@given(st.lists(TOLD, max_size=30))
def test_tally_matches_remembering_every_run(told):
    counted, reused, executed, judged = Tally(), set(), {}, {}
    counted.expect(WANTED)
    for what, configuration, runs in told:
        getattr(counted, what)(configuration, runs)
        wanted = {(configuration, run): run for run in runs if run < WANTED.get(configuration, 0)}
        if what == "reuse":
            reused |= wanted.keys() - executed.keys()
        elif what == "execute":
            executed = {key: runs[run] for key, run in wanted.items()} | executed
            reused -= wanted.keys()
        else:
            judged |= {key: runs[run] for key, run in wanted.items()}
    done = Counter(configuration for configuration, _ in judged)
    said = Counter(judged.values())
    assert counted.progress() == Progress(
        configurations_done=sum(done[configuration] == runs for configuration, runs in WANTED.items()),
        configurations_total=3,
        runs_done=len(judged),
        runs_total=6,
        executed=len(executed),
        reused=len(reused),
        passed=said["pass"],
        failed=said["fail"],
        not_judged=said["not judged"],
        simulated_s=sum(executed.values()),
    )


class Recorder:
    def __init__(self):
        self.seen = []
        self.threads = set()

    def update(self, progress):
        self.seen.append(progress)
        self.threads.add(threading.get_ident())


def test_observer_is_shown_the_first_and_the_last_state_from_one_thread():
    recorder, counted = Recorder(), tally()
    with Reporter(counted, recorder):
        counted.begin("running")
        counted.judge("room-1", {0: "pass"})
    assert recorder.seen[-1] == counted.progress()
    assert len(recorder.threads) == 1
    assert recorder.threads != {threading.get_ident()}


def test_possible_runs_count_until_they_are_ruled_out():
    counted = Tally()
    counted.expect({"a": 2, "b": 2})
    for configuration in "ab":
        counted.want(configuration, 2, 5)
        counted.judge(configuration, {0: "pass", 1: "pass", 2: "pass"})
    open_ones = counted.progress()
    assert (open_ones.runs_done, open_ones.runs_total, open_ones.configurations_done, open_ones.at_most) == (
        4,
        10,
        0,
        True,
    )
    counted.want("a", 2, 2)
    counted.want("b", 5, 5)
    counted.judge("b", {2: "fail", 3: "pass", 4: "pass"})
    done = counted.progress()
    assert (done.runs_done, done.runs_total, done.configurations_done, done.at_most) == (7, 7, 2, False)
    assert (done.passed, done.failed) == (6, 1)
