import logging
import os
import subprocess
import sys
import textwrap
import warnings
from datetime import datetime

import pytest

from vastflow.tasks.prefect.adapter import import_prefect
from vastflow.tasks.prefect.campaign_log import new_log, own_log, prefect_log

pytestmark = pytest.mark.timeout(900)  # its processes import Prefect: 4 CPU-s, and minutes where many others compute


def test_records_of_vastflow_go_to_the_log_alone(tmp_path, capsys):
    log = tmp_path / "log"
    with own_log(log):
        logging.getLogger("vastflow.store").warning("damaged")
    assert "WARNING vastflow.store: damaged" in log.read_text()
    assert capsys.readouterr().err == ""


def test_quiet_campaign_leaves_no_log(tmp_path):
    with own_log(tmp_path / "log"):
        pass
    assert not (tmp_path / "log").exists()


def test_old_logs_are_removed(tmp_path):
    for i in range(60):
        (tmp_path / f"{i:02}.log").touch()
        os.utime(tmp_path / f"{i:02}.log", (i, i))
    new_log(tmp_path, "tiny", datetime(2026, 11, 21)).touch()
    names = sorted(file.name for file in tmp_path.iterdir())
    assert (len(names), names[0], names[-1]) == (50, "11.log", "tiny-2026-11-21-000000-000000.log")


def test_records_of_prefect_and_libraries_never_reach_the_terminal(tmp_path):
    script = textwrap.dedent(f"""
        import logging, pathlib, warnings
        from vastflow.tasks.prefect.campaign_log import prefect_log
        with prefect_log(pathlib.Path({str(tmp_path / "log")!r})):
            logging.getLogger("prefect.flow_runs").error("from prefect")
            logging.getLogger("prefect._internal").error("from inside")
            logging.getLogger("asyncio").error("from asyncio")
            warnings.warn("a warning")
        logging.getLogger("prefect.events").error("from a service at exit")
        print(logging.getLogger().handlers)
    """)
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")
    said = (tmp_path / "log").read_text()
    for words in ("from prefect", "from inside", "from asyncio", "a warning", "from a service at exit"):
        assert said.count(f"{words}\n") == 1


def test_next_campaign_of_process_has_own_log(tmp_path):
    script = textwrap.dedent(f"""
        import logging, pathlib
        from vastflow.tasks.prefect.campaign_log import own_log, prefect_log
        for name in ("first", "second"):
            log = pathlib.Path({str(tmp_path)!r}, name)
            with own_log(log), prefect_log(log):
                logging.getLogger("prefect.flow_runs").warning("from %s", name)
                logging.getLogger("vastflow.store").warning("of %s", name)
        logging.getLogger("prefect.events").error("after both")
    """)
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("", "")
    assert "from first\n" in (tmp_path / "first").read_text() and "from second" not in (tmp_path / "first").read_text()
    second = (tmp_path / "second").read_text()
    assert "from second\n" in second and "of second\n" in second


def test_prefect_logging_is_restored_for_caller(tmp_path):
    import prefect.main  # noqa: F401

    logger, root = logging.getLogger("prefect"), logging.getLogger()
    before = (list(logger.handlers), logger.propagate, logger.level, list(root.handlers), warnings.showwarning)
    with prefect_log(tmp_path / "log"):
        pass
    assert (list(logger.handlers), logger.propagate, logger.level, list(root.handlers), warnings.showwarning) == before


@pytest.mark.parametrize("logged", [own_log, prefect_log])
def test_logs_of_two_campaigns_at_once_leave_the_loggers_as_they_were(tmp_path, logged):
    import_prefect()
    loggers = [logging.getLogger(name) for name in ("vastflow", "prefect")]
    before = [(list(logger.handlers), logger.propagate) for logger in loggers]
    first, second = logged(tmp_path / "first"), logged(tmp_path / "second")
    for each in (first, second):
        each.__enter__()
    for each in (first, second):  # the one that began first ends first
        each.__exit__(None, None, None)
    assert [(list(logger.handlers), logger.propagate) for logger in loggers] == before
