import threading

from vastflow.tasks.progress import Progress, Reporter, Tally


def tally():
    made = Tally()
    made.expect({"room-1": 2, "room-2": 2})
    return made


def test_what_is_expected_is_the_total():
    progress = tally().progress()
    assert (progress.configurations_total, progress.runs_total) == (2, 4)


def test_a_configuration_is_done_when_all_its_runs_are_judged():
    counted = tally()
    counted.judge("room-1", {0: "pass"})
    assert counted.progress().configurations_done == 0
    counted.judge("room-1", {1: "fail"})
    progress = counted.progress()
    assert (progress.configurations_done, progress.runs_done) == (1, 2)
    assert (progress.passed, progress.failed, progress.not_judged) == (1, 1, 0)


def test_a_run_told_of_twice_counts_once_and_the_last_word_counts():
    counted = tally()
    counted.judge("room-1", {0: "not judged"})
    counted.judge("room-1", {0: "pass"})
    progress = counted.progress()
    assert (progress.runs_done, progress.passed, progress.not_judged) == (1, 1, 0)


def test_runs_nobody_asked_for_do_not_count():
    counted = tally()
    counted.reuse("room-1", range(5))
    counted.judge("room-1", {0: "pass", 4: "pass"})
    progress = counted.progress()
    assert (progress.reused, progress.runs_done) == (2, 1)


def test_a_run_executed_by_this_call_is_not_reused_when_it_is_found_again():
    counted = tally()
    counted.execute("room-1", {0: 10.0, 1: 20.0})
    counted.reuse("room-1", range(2))
    progress = counted.progress()
    assert (progress.executed, progress.reused, progress.simulated_s) == (2, 0, 30.0)


def test_a_run_found_damaged_after_it_counted_as_reused_is_executed():
    counted = tally()
    counted.reuse("room-1", range(2))
    counted.execute("room-1", {1: 20.0})
    progress = counted.progress()
    assert (progress.executed, progress.reused) == (1, 1)


class Recorder:
    def __init__(self):
        self.seen = []
        self.threads = set()

    def update(self, progress):
        self.seen.append(progress)
        self.threads.add(threading.get_ident())


def test_an_observer_is_shown_the_first_and_the_last_state_from_one_thread():
    recorder, counted = Recorder(), tally()
    with Reporter(counted, recorder):
        counted.begin("running")
        counted.judge("room-1", {0: "pass"})
    assert recorder.seen[-1] == counted.progress()
    assert len(recorder.threads) == 1
    assert recorder.threads != {threading.get_ident()}


def test_without_an_observer_nothing_is_shown():
    with Reporter(tally(), None):
        pass


def test_progress_is_a_value():
    assert Progress(phase="running") == Progress(phase="running")
