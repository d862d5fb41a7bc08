"""The report in a real browser: nothing on its console, tables that sort and filter, plain tables without its script."""

import base64
import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import CHROMIUM, Browser, chromium, opened
from PIL import Image

from vastflow.oracles.page.report import write_report

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")


@pytest.fixture(scope="module")
def debugged(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a Chromium."""
    with chromium(tmp_path_factory.mktemp("chromium")) as address:
        yield address


@pytest.fixture
def browser(debugged: str) -> Iterator[Browser]:
    browser = opened(debugged)
    yield browser
    browser.ask("Emulation.setScriptExecutionDisabled", value=False)
    browser.ask("Page.navigate", url="about:blank")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, build) -> Path:
    """A report of 70 configurations in two families; the k-th fails min(k mod 5, 3) of its three runs."""
    campaign = build.campaign(tmp_path_factory.mktemp("results"))
    room = build.write_map(tmp_path_factory.mktemp("room"), build.walled_room(6.0, 4.0))
    task = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
    way = [(1.0 + 0.1 * i, 2.0) for i in range(41)]
    for k in range(70):
        lost = min(k % 5, 3)
        runs = [
            build.a_recording(way[:20], run_index=i, outcome="aborted", reason="stuck </script>") for i in range(lost)
        ]
        runs += [build.a_recording(way, run_index=i) for i in range(lost, 3)]
        family = ("quiet", "noisy")[k % 2]
        factors = {"stop": {"x": 7.0 * (k % 4) - 9.0, "y": -1.5}, "noise": 0.1 * (k % 7), "way": k % 3}
        campaign.add(f"{family}-{k + 1}", family, room, task, recordings=runs, factors=factors)
    directory = campaign.write()
    write_report(directory)
    return directory / "report.html"


ROWS = (
    "[...document.querySelectorAll('#configurations tbody tr')].map(row => [...row.cells].map(cell => cell.innerText))"
)
ONLY_FAILING = "document.querySelector('#all .tools input[type=checkbox]').click()"
COUNT = "document.querySelector('#all .tools output').value"


def open_table(browser: Browser, report: Path) -> None:
    """Open the page, its table of configurations, and all rows of it."""
    browser.open(report)
    browser.value("document.querySelector('nav a[href=\"#all\"]').click()")
    browser.value(ONLY_FAILING)


def click(head: str) -> str:
    return f"[...document.querySelectorAll('#configurations th button')].find(b => b.innerText === {head!r}).click()"


def chosen(element: str, value: str, event: str) -> str:
    return f"{{const it = document.querySelector({element!r}); it.value = {value!r}; it.dispatchEvent(new Event({event!r}))}}"


def test_browser_console_stays_empty_and_reasons_of_runs_end_no_script(browser: Browser, report: Path) -> None:
    browser.open(report)
    pictures = "[...document.images].filter(image => { image.loading = 'eager'; return true }).length"
    assert browser.value(pictures) > 5
    loaded = "Promise.all([...document.images].map(image => image.decode())).then(() => 'all')"
    found = browser.ask("Runtime.evaluate", expression=loaded, awaitPromise=True, returnByValue=True)
    assert found["result"]["value"] == "all"
    assert browser.complaints == []
    page = report.read_text(encoding="utf-8")
    assert len(re.findall(r"</script>", page)) == len(re.findall(r"<script", page))


def test_click_on_head_sorts_and_second_click_reverses(browser: Browser, report: Path) -> None:
    open_table(browser, report)
    browser.value(click("Configuration"))
    names = [row[0] for row in browser.value(ROWS)]
    assert names[:3] == ["noisy-2", "noisy-4", "noisy-6"]  # by the numbers in them, not noisy-10 before noisy-2
    browser.value(click("Configuration"))
    assert browser.value(ROWS)[0][0] == "quiet-69"
    assert browser.value("document.querySelector('#configurations th').ariaSort") == "descending"
    browser.value(click("noise"))
    assert [float(row[-2]) for row in browser.value(ROWS)][:11] == [0.6] * 10 + [0.5]
    browser.value(click("stop"))
    places = [row[-3] for row in browser.value(ROWS)]
    assert list(dict.fromkeys(places)) == [f"({x}, −1.50) m" for x in ("−9.00", "−2.00", "5.00")]  # 50 of 70 rows
    browser.value(click("stop"))
    assert browser.value(ROWS)[0][-3] == "(12.00, −1.50) m"


def test_table_shows_failures_filters_rows_and_adds_more(browser: Browser, report: Path) -> None:
    browser.open(report)
    browser.value("document.querySelector('nav a[href=\"#all\"]').click()")
    assert browser.value(COUNT) == "50 of 56 rows (of 70)"
    browser.value(ONLY_FAILING)
    assert browser.value(COUNT) == "50 of 70 rows"
    browser.value(chosen("#all input", "QUIET-1 undecided", "input"))
    assert {row[0] for row in browser.value(ROWS)} == {f"quiet-{k}" for k in (1, 11, 13, 15, 17, 19)}
    assert browser.value(COUNT) == "6 of 6 rows (of 70)"
    browser.value(chosen("#all input", "", "input"))
    browser.value(chosen("#all select", "noisy", "change"))
    assert {row[1] for row in browser.value(ROWS)} == {"noisy"}
    open_table(browser, report)
    assert len(browser.value(ROWS)) == 50
    browser.value("document.querySelector('#all .more').click()")
    assert len(browser.value(ROWS)) == 70
    assert browser.value("document.querySelector('#all .more').hidden") is True


def press_enter(browser: Browser) -> None:
    for kind in ("rawKeyDown", "char", "keyUp"):
        browser.ask("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")


def test_heads_links_and_folds_work_by_keyboard_and_click(browser: Browser, report: Path) -> None:
    open_table(browser, report)
    browser.value("document.querySelector('#configurations th button').focus()")
    press_enter(browser)
    assert browser.value("document.querySelector('#configurations th').ariaSort") == "ascending"
    browser.open(report)
    browser.value("document.querySelector('#rates summary').focus()")
    press_enter(browser)
    assert browser.value("document.querySelector('#rates').open") is True
    assert browser.value("document.querySelector('#method').open") is False
    browser.value("document.querySelector('#why a[href=\"#method\"]').click()")
    assert browser.value("document.querySelector('#method').open") is True


def test_plain_table_without_script_has_worst_first(browser: Browser, report: Path) -> None:
    browser.ask("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(report)
    browser.value("document.querySelector('#all').open = true")
    rows = browser.value(ROWS)
    assert len(rows) == 40
    assert rows[0][3].startswith("0\u00a0%")
    assert browser.value("document.querySelector('#configurations caption').innerText").startswith("The first 40 of 70")
    assert browser.value("document.querySelectorAll('.tools').length") == 0


def test_printed_page_unfolds_sections(browser: Browser, report: Path) -> None:
    browser.open(report)
    browser.value("document.querySelectorAll('details').forEach(it => { it.dataset.was = it.open })")
    printed = base64.b64decode(browser.ask("Page.printToPDF")["data"])
    assert printed.count(b"/Type /Page\n") + printed.count(b"/Type/Page/") + printed.count(b"/Type /Page ") > 6
    assert browser.value("[...document.querySelectorAll('details')].every(it => String(it.open) === it.dataset.was)")


def promised(browser: Browser, expression: str) -> object:
    found = browser.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
    assert "exceptionDetails" not in found, found
    return found["result"].get("value")


def test_browser_plays_film_on_request(browser: Browser, report: Path) -> None:
    browser.open(report)
    film = "const film = document.querySelector('video')"
    state = "[film.paused, film.videoWidth, film.duration > 1]"
    look = f"const look = () => film.readyState ? done({state}) : setTimeout(look, 50)"
    assert promised(browser, f"new Promise(done => {{ {film}; {look}; look() }})") == [True, 600, True]
    ends = "film.playbackRate = 8; film.onended = () => done('ended'); film.onerror = () => fail(film.error)"
    played = f"new Promise((done, fail) => {{ {film}; {ends}; film.play().catch(fail) }})"
    assert promised(browser, played) == "ended"


def test_narrow_page_in_dark_mode_has_dark_figures(browser: Browser, report: Path) -> None:
    browser.ask("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    try:
        for scheme, is_dark in (("light", False), ("dark", True)):
            told = {"name": "prefers-color-scheme", "value": scheme}
            browser.ask("Emulation.setEmulatedMedia", features=[told])
            browser.open(report)
            assert browser.value("document.documentElement.scrollWidth") == 390
            browser.value("document.querySelector('main img').scrollIntoView({ block: 'center' })")
            assert promised(browser, "document.querySelector('main img').decode().then(() => true)")
            place = browser.value(
                "(() => { const { x, y } = document.querySelector('main img').getBoundingClientRect(); return [x + scrollX, y + scrollY] })()"
            )
            clip = {"x": place[0], "y": place[1], "width": 200, "height": 100, "scale": 1}
            shot = base64.b64decode(browser.ask("Page.captureScreenshot", format="png", clip=clip)["data"])
            assert (np.median(Image.open(io.BytesIO(shot)).convert("L")) < 64) == is_dark
    finally:
        browser.ask("Emulation.clearDeviceMetricsOverride")
        browser.ask("Emulation.setEmulatedMedia", features=[])
