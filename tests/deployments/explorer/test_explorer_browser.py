"""The explorer in a real browser: list, two ticked campaigns compared, back, and running campaigns to their ends."""

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from subprocess import Popen
from typing import TypeAlias

import pytest
from asleep import gated, sleepers
from chromium import CHROMIUM, Browser, chromium, opened

from vastflow.oracles.results.events import EVENTS, Event, EventReader
from vastflow.oracles.results.unfinished import STOP, WRITER, unfinished, writer

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")]

PATIENCE_S = 150


@pytest.fixture
def explorer(results: Path) -> Iterator[str]:
    """The address that `vastflow ui` prints."""
    command = [sys.executable, "-m", "vastflow.flows.cli", "ui", str(results), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A browser whose page must not complain."""
    with chromium(tmp_path / "chromium") as address:
        browser = opened(address)
        yield browser
        assert browser.complaints == []


def visit(browser: Browser, address: str) -> None:
    browser.ask("Page.navigate", url=address)
    until(browser, "document.readyState === 'complete' && location.protocol === 'http:'")


def arrive(browser: Browser, path: str) -> None:
    """Wait until a page that was gone to is there with its style."""
    until(browser, f"location.pathname === '{path}' && document.readyState === 'complete'")


def until(browser: Browser, expression: str) -> None:
    """Wait until an expression of JavaScript is true."""
    end_s = time.monotonic() + PATIENCE_S
    while not browser.value(f"Boolean({expression})"):
        assert time.monotonic() < end_s, f"{expression}: {browser.value('document.body.innerText')}"
        time.sleep(0.05)


def press(browser: Browser, key: str, text: str = "") -> None:
    codes = {"Tab": 9, "Enter": 13, " ": 32}
    own = {"key": key, "windowsVirtualKeyCode": codes[key], **({"text": text} if text else {})}
    browser.ask("Input.dispatchKeyEvent", type="keyDown", **own)
    browser.ask("Input.dispatchKeyEvent", type="keyUp", **own)


def narrow(browser: Browser, dark: bool) -> None:
    browser.ask("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    browser.ask("Emulation.setEmulatedMedia", features=features)


def test_list_compares_two_ticked_campaigns_by_keyboard(
    browser: Browser, explorer: str, add_campaign: Callable[..., Path]
) -> None:
    for day, lost in ((20, 0), (21, 1), (22, 4)):
        add_campaign(day, {"room": [lost, 1], "aisle": [0]})
    visit(browser, explorer)
    assert "token" not in browser.value("location.href")
    rows = browser.value("[...document.querySelectorAll('tbody tr')].map(row => row.innerText)")
    assert [re.search(r"2026-11-\d\d", row)[0] for row in rows] == ["2026-11-22", "2026-11-21", "2026-11-20"]
    assert browser.value("document.querySelector('button.main').disabled")
    ticked = 0
    for _ in range(40):
        press(browser, "Tab")
        if browser.value("document.activeElement.type") == "checkbox" and ticked != 1:
            press(browser, " ", " ")
        ticked += browser.value("document.activeElement.type") == "checkbox"
        if ticked == 3:
            break
    assert browser.value("document.querySelectorAll('input:checked').length") == 2
    assert browser.value("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert not browser.value("document.querySelector('button.main').disabled")
    browser.value("document.querySelector('button.main').focus()")
    press(browser, "Enter", "\r")
    arrive(browser, "/compare")
    shown = browser.value("document.querySelector('table.plain').innerText")
    assert shown.index("2026-11-20") < shown.index("2026-11-22")
    assert "room-1" in browser.value("document.body.innerText")
    browser.value("document.querySelector('details.picture').open = true")
    until(browser, "document.querySelector('details.picture img').naturalWidth > 100")
    browser.value("history.back()")
    arrive(browser, "/")
    until(browser, "document.querySelectorAll('input:checked').length === 2")
    until(browser, "!document.querySelector('button.main').disabled")


@pytest.mark.parametrize("dark", [False, True])
def test_pages_fit_a_narrow_screen(
    browser: Browser, explorer: str, add_campaign: Callable[..., Path], dark: bool
) -> None:
    for day, lost in ((20, 0), (21, 4)):
        add_campaign(day, {"room": [lost, 1], "aisle": [0]}, text=f"version: 1\n{'# ' + 80 * 'x'}\n# {day}\n")
    narrow(browser, dark)
    visit(browser, explorer)
    browser.value("for (const each of document.querySelectorAll('details')) each.open = true")
    assert browser.value("document.documentElement.scrollWidth") <= 390
    browser.value("document.querySelectorAll('input').forEach(each => each.click())")
    browser.value("document.querySelector('button.main').click()")
    arrive(browser, "/compare")
    assert browser.value("document.documentElement.scrollWidth") <= 390
    ground = browser.value("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", ground))) < 200) == dark


def test_running_campaign_is_followed_and_stopped_with_a_reason(
    browser: Browser, explorer: str, results: Path, add_campaign: Callable[..., Path]
) -> None:
    add_campaign(20, {"room": [1]})
    visit(browser, explorer)
    until(browser, "document.querySelectorAll('tbody tr').length === 1")
    place = results / ".office-2026-11-21-060000.running"
    place.mkdir()
    (place / WRITER).write_text(json.dumps(writer()))

    def tell(event: str, **values: object) -> None:
        with open(place / EVENTS, "ab") as file:
            file.write(Event(datetime.now().astimezone(), event, values).line)

    tell("began", name="<b>office</b>")
    until(browser, "document.querySelector('tbody').innerText.includes('running')")  # without a reload
    browser.value("document.querySelector('tbody a').click()")
    arrive(browser, "/live")
    until(browser, "!document.getElementById('stop').hidden")
    of = {"configuration": "room <1>", "family": "room"}
    tell("verdicts", **of, judgment="fail", reason="contact", runs=[3])
    family = {"family": "room", "configurations": 1, "runs": 8, "passed": 0, "failed": 1, "not_judged": 0}
    tell("progress", phase="running", runs_done=1, runs_total=8, executed=1, failed=1, families=[family])
    until(browser, "document.querySelector('#lost a')")
    assert browser.value("document.querySelector('#lost a').href").endswith("&configuration=room+%3C1%3E&run=3")
    assert "room <1>" in browser.value("document.getElementById('lost').innerText")
    until(browser, "document.getElementById('families').innerText.includes('1 of 8')")
    assert browser.value("document.querySelector('h1').innerText").startswith("<b>office</b>")
    browser.value("document.querySelector('[name=reason]').value = 'wrong file'")
    browser.value("document.querySelector('#stop button').click()")
    end_s = time.monotonic() + PATIENCE_S
    while not (place / STOP).exists():
        assert time.monotonic() < end_s
        time.sleep(0.05)
    tell("stopped", reason=json.loads((place / STOP).read_text())["reason"])
    (place / WRITER).unlink()
    until(browser, "document.getElementById('end').innerText === 'The campaign stopped: wrong file.'")
    assert browser.value("document.getElementById('stop').hidden")
    visit(browser, browser.value("location.origin + '/'"))
    assert "wrong file" in browser.value("document.querySelector('tbody').innerText")


def test_ended_campaign_links_to_its_page(
    browser: Browser, explorer: str, results: Path, add_campaign: Callable[..., Path]
) -> None:
    place = results / ".office-2026-11-21-060000.running"
    place.mkdir()
    (place / WRITER).write_text(json.dumps(writer()))
    began, ended = (Event(datetime.now().astimezone(), event, {"name": "office"}) for event in ("began", "ended"))
    (place / EVENTS).write_bytes(began.line)
    visit(browser, explorer)
    browser.value("document.querySelector('tbody a').click()")
    arrive(browser, "/live")
    until(browser, "!document.getElementById('stop').hidden")
    whole = add_campaign(21, {"room": [1]})
    (whole / EVENTS).write_bytes(began.line + ended.line)
    shutil.rmtree(place)
    until(browser, "document.querySelector('#end a')")
    assert browser.value("document.querySelector('#end a').href.replace('/campaign', '/live') === location.href")


Begin: TypeAlias = Callable[[], Popen[str]]


@pytest.fixture
def begin(
    request: pytest.FixtureRequest, tmp_path: Path, results: Path, prefect_home: Callable[[Path], Path]
) -> Iterator[Begin]:
    """Begins a real campaign with a run that fails, and so many that wait until there is a file `go`."""
    home, waiting = prefect_home(tmp_path / "prefect"), [f"{gated(tmp_path)} {k}" for k in range(request.param)]
    with sleepers(tmp_path, home, ["sh -c 'sleep 1; exit 3'", *waiting], runs=1, workers=2) as start:
        yield lambda: start(str(results))


def watch(browser: Browser, explorer: str) -> None:
    """Open the live page from the list, which shows the campaign without a reload, and wait for the failed run."""
    visit(browser, explorer)
    until(browser, "document.querySelector('tbody')?.innerText.includes('running')")
    browser.value("document.querySelector('tbody a').click()")
    arrive(browser, "/live")
    until(browser, "document.querySelector('#lost a')")
    assert "asleep-1" in browser.value("document.getElementById('lost').innerText")


@pytest.mark.timeout(300)
@pytest.mark.parametrize("begin", [2], indirect=True)
def test_real_campaign_is_watched_to_its_end(browser: Browser, explorer: str, begin: Begin, tmp_path: Path) -> None:
    process = begin()
    watch(browser, explorer)
    assert process.poll() is None and browser.value("document.getElementById('end').innerText") == ""
    (tmp_path / "go").touch()
    until(browser, "document.querySelector('#recent .pass')")
    until(browser, "document.getElementById('end').innerText.startsWith('The campaign is finished.')")
    assert "3 of 3" in browser.value("document.getElementById('families').innerText")
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and re.search(r"asleep +3 +3 +2 +1 +66.7 %", said), said
    browser.value("document.querySelector('#end a').click()")
    arrive(browser, "/campaign")
    until(browser, "document.body.innerText.includes('asleep-3')")
    assert browser.value("document.querySelector('h1').innerText").startswith("asleep")


@pytest.mark.timeout(300)
@pytest.mark.parametrize("begin", [1], indirect=True)
def test_real_campaign_opens_failed_run_and_is_stopped(
    browser: Browser, explorer: str, begin: Begin, results: Path
) -> None:
    process = begin()
    watch(browser, explorer)
    (place,) = unfinished(results)
    browser.value("document.querySelector('#lost a').click()")
    arrive(browser, "/run")  # from the store
    until(browser, "document.body.innerText.includes('has no robot')")
    browser.value("history.back()")
    arrive(browser, "/live")
    until(browser, "!document.getElementById('stop').hidden")
    browser.value("document.querySelector('[name=reason]').value = 'wrong <sleep>'")
    browser.value("document.querySelector('#stop button').click()")
    until(browser, "document.getElementById('end').innerText === 'The campaign stopped: wrong <sleep>.'")
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130 and "stopped: wrong <sleep>" in said.splitlines()[-1]
    assert EventReader(place).new()[-1].values["reason"] == "wrong <sleep>"
    visit(browser, browser.value("location.origin + '/'"))
    assert "wrong <sleep>" in browser.value("document.querySelector('tbody').innerText")
