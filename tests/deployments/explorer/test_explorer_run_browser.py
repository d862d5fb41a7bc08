"""The replay of runs in a real browser: clock, keys, time line, lock step, layers, narrow and dark pages."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import uvicorn
from chromium import CHROMIUM, Browser, chromium, opened
from mcap.reader import make_reader
from synthetic import SyntheticCampaign, a_recording, box_at, walled_room, write_map

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application
from vastflow.deployments.explorer.serving import LOOPBACK, listen
from vastflow.sim.model.recording import Event
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.run import run
from vastflow.sim.world.world import map_content

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]

TOKEN = "a-token-of-the-tests"
WAIT_S = 60.0
TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
WALK = [(1.0 + 0.1 * i, 2.0) for i in range(41)]
CONTACTS = (
    Event(0.5, "recovery", 1.5, 2.0, "spin"),
    Event(1.25, "contact", 2.25, 2.0, "box", 0.2),
    Event(1.9, "contact", 2.9, 2.0, "wall", 0.1),
)
EXECUTED_S = 4.0
NAME = "office <b>&1"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with hand-built runs, of which 0 and 2 failed, and with an executed one."""
    folder = tmp_path_factory.mktemp("results")
    room = write_map(tmp_path_factory.mktemp("room"), walled_room(6.0, 4.0))
    campaign = SyntheticCampaign(folder / "office-2026-11-03-060000")
    runs = [
        a_recording(WALK[:25], outcome="aborted", reason="stuck", events=CONTACTS),
        a_recording(WALK, run_index=1),
        a_recording(WALK[:9], run_index=2, outcome="aborted", reason="stuck"),
    ]
    campaign.add(NAME, "office", room, TASK, recordings=runs, obstacles=[box_at(3.5, 2.6)])
    environment = {"map_file": map_content(room), "static_objects": []}
    executed = Scenario("builtin:navigate_to_pose", EXECUTED_S, environment, TASK, {})
    recording = run(executed, 0, 5)
    campaign.add("executed-1", "executed", room, TASK, recordings=[recording])
    campaign.configurations[-1] |= {"timeout_s": EXECUTED_S, "scenario_digest": executed.digest}
    campaign.metadata |= {"name": "office", "created": "2026-11-03T06:00:00"}
    directory = campaign.write()
    earlier = SyntheticCampaign(folder / "office-2026-11-02-060000")
    earlier.add("desk-1", "desk", room, TASK, recordings=[a_recording(WALK[:31])])
    earlier.metadata |= {"name": "office", "created": "2026-11-02T06:00:00"}
    earlier.write()
    names = {"configuration": ["executed-1"] * len(recording.behaviors["t_s"])}
    behaviors = {**names, "run_index": np.zeros(len(names["configuration"]), dtype=np.int64), **recording.behaviors}
    pq.write_table(pa.table(behaviors), directory / "behaviors.parquet")
    return folder


@pytest.fixture(scope="module")
def place(results: Path) -> Iterator[str]:
    """The address of an explorer."""
    with listen(0) as listening:
        app = application(Directories([results]), TOKEN)
        server = uvicorn.Server(uvicorn.Config(app, log_level="warning", lifespan="off", timeout_graceful_shutdown=1))
        thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
        thread.start()
        yield f"http://{LOOPBACK}:{listening.getsockname()[1]}"
        server.should_exit = True
        thread.join(20)


@pytest.fixture(scope="module")
def debugged(tmp_path_factory: pytest.TempPathFactory, place: str) -> Iterator[str]:
    with chromium(tmp_path_factory.mktemp("chromium")) as address:
        browser = opened(address)
        browser.ask("Page.navigate", url=f"{place}/?token={TOKEN}")
        wait(browser, "document.title.includes('vastflow')")
        yield address


class Page:
    """The page of a run in a browser."""

    def __init__(self, browser: Browser, place: str, campaign: str, earlier: str) -> None:
        self.browser, self._place, self._campaign, self.earlier = browser, place, campaign, earlier

    def open(self, configuration: str = NAME, run_index: int = 0, **others: object) -> None:
        query = {"c": self._campaign, "configuration": configuration, "run": run_index, "paused": 1, **others}
        self.browser.ask("Page.navigate", url="about:blank")
        self.browser.ask("Page.navigate", url=f"{self._place}/run?{urlencode(query)}")
        wait(
            self.browser, "document.querySelector('.time')?.textContent"
        )  # which is empty until the recording is there

    def press(self, key: str, shift: bool = False) -> None:
        for kind in ("rawKeyDown", "keyUp"):
            self.browser.ask("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0)

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self.browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def shows(self, time_text: str) -> bool:
        return wait(self.browser, f"document.querySelector('.time').textContent.startsWith({time_text!r})")

    def text(self, selector: str) -> str:
        return self.browser.value(f"document.querySelector({selector!r}).textContent")

    def color_at(self, x_m: float, y_m: float, map_index: int = 0) -> list[int]:
        """Red, green, and blue of the map at a place, with the whole room in view."""
        return self.browser.value(f"""(() => {{
            const canvas = document.querySelectorAll('canvas.map')[{map_index}];
            const scale = Math.min((canvas.clientWidth - 24) / 6, (canvas.clientHeight - 24) / 4);
            const x = canvas.clientWidth / 2 + ({x_m} - 3) * scale, y = canvas.clientHeight / 2 - ({y_m} - 2) * scale;
            const one = new OffscreenCanvas(1, 1).getContext('2d', {{ willReadFrequently: true }});
            one.drawImage(canvas, -Math.round(x), -Math.round(y));
            return [...one.getImageData(0, 0, 1, 1).data].slice(0, 3);
        }})()""")


def wait(browser: Browser, expression: str) -> bool:
    """Wait until an expression holds."""
    until = time.monotonic() + WAIT_S
    while not browser.value(f"Boolean({expression})"):
        assert time.monotonic() < until, (
            f"{expression} did not hold; the page has {browser.value('document.body.innerText')}"
        )
        time.sleep(0.03)
    return True


@pytest.fixture
def page(debugged: str, place: str, results: Path) -> Iterator[Page]:
    browser = opened(debugged)
    browser.ask("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)
    browser.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])
    campaign, earlier = Directories([results]).all()
    yield Page(browser, place, campaign.id, earlier.id)
    assert browser.complaints == []


def test_run_page_shows_moment_of_its_address(page: Page):
    page.open(t=0.5)
    assert page.shows("0.50 s of 2.50 s")
    assert page.color_at(1.45, 2.1) == [28, 33, 38]  # the robot's body
    assert page.color_at(3.0, 1.0) == [255, 255, 255]
    assert page.color_at(0.01, 2.0) == [58, 63, 71]
    red, green, blue = page.color_at(3.5, 2.6)
    assert red > green + 30 < blue + 20  # the obstacle
    assert "touches box at 0.20 m/s" in page.text(".events")
    assert page.text("h1") == f"{NAME}, run 0"
    assert "stuck" in page.text(".panels")


def test_path_has_the_color_of_its_verdict(page: Page):
    colors = []
    for run_index in (0, 1):
        page.open(run_index=run_index, t=2)
        colors.append(page.color_at(1.15, 2.0))
    assert colors == [[194, 84, 0], [0, 114, 178]]  # failed, passed


def test_keys_move_the_clock(page: Page):
    page.open(t=0.5)
    for key, shift, shown in [
        *(
            ("c", False, "1.25 s"),
            ("c", False, "1.90 s"),
            ("ArrowLeft", False, "1.80 s"),
            ("ArrowLeft", True, "0.80 s"),
        ),
        *((".", False, "0.85 s"), (",", False, "0.80 s"), ("ArrowRight", False, "0.90 s"), ("End", False, "2.50 s")),
        *(("ArrowRight", False, "2.50 s"), ("Home", False, "0.00 s"), (",", False, "0.00 s"), ("e", False, "0.50 s")),
    ]:
        page.press(key, shift)
        assert page.shows(shown), key
    page.press("End")
    page.press("c")
    assert page.text("[role=status]") == "No contact comes after this moment."
    page.press("]")
    assert page.browser.value("document.querySelector('#speed').value") == "2"
    page.press("[")
    page.press("[")
    assert page.browser.value("document.querySelector('#speed').value") == "0.5"
    page.press("?")
    assert page.browser.value("document.querySelector('dialog').open") is True
    page.press("End")  # of the dialog's, not of the run's
    assert page.browser.value("document.querySelector('dialog').open") is True


def test_space_plays_to_the_end_and_pauses(page: Page):
    page.open(t=0)
    for _ in range(3):
        page.press("[")  # 25 s for all, however slow the browser is
    page.press(" ")
    assert page.text("[data-action=toggle]") == "Pause"
    page.press("End")
    assert page.shows("2.50 s")
    wait(page.browser, "document.querySelector('[data-action=toggle]').textContent === 'Play'")
    page.press(" ")  # from the start again
    wait(page.browser, "Number.parseFloat(document.querySelector('.time').textContent) > 0")
    page.press(" ")
    assert page.text("[data-action=toggle]") == "Play"


def test_time_line_and_event_list_go_to_a_moment(page: Page):
    page.open(t=0)
    x, y, width = page.browser.value(
        "(() => { const r = document.querySelector('[role=slider]').getBoundingClientRect(); return [r.x, r.y, r.width] })()"
    )
    page.click(x + 52 + (width - 64) * 1.0 / 2.5, y + 32)
    wait(page.browser, "Math.abs(Number.parseFloat(document.querySelector('.time').textContent) - 1) < 0.02")
    page.click(x + 52 + (width - 64) * 1.25 / 2.5 + 3, y + 8)  # near a contact
    assert page.shows("1.25 s")
    page.browser.value(
        "[...document.querySelectorAll('.events button')].find(e => e.textContent.includes('spin')).click()"
    )
    assert page.shows("0.50 s")


def test_address_keeps_the_moment_and_back_leaves(page: Page):
    page.open(t=0.5)
    page.press("c")
    wait(page.browser, "/t=1.25(&|$)/.test(location.search)")
    page.browser.ask("Page.reload")
    page.browser.value("1")
    wait(page.browser, "document.querySelector('.time')?.textContent.startsWith('1.25 s')")
    page.press("n")
    wait(page.browser, f"document.querySelector('h1')?.textContent === {NAME + ', run 2'!r}")
    page.press("n")  # not before the page is there
    wait(page.browser, "document.querySelector('.time')")
    page.browser.value("history.back()")
    wait(
        page.browser,
        "/t=1.25(&|$)/.test(location.search) && document.querySelector('.time')?.textContent.startsWith('1.25 s')",
    )


def test_choosing_a_run_keeps_moment_and_pause(page: Page):
    page.open(t=0.5)
    page.press("c")
    assert page.shows("1.25 s")
    page.browser.value(
        "(() => { const s = document.querySelector('[name=withrun]'); s.value = '1'; s.dispatchEvent(new Event('change', { bubbles: true })) })()"
    )
    wait(page.browser, "document.querySelectorAll('canvas.map').length === 2")
    assert page.shows("1.25 s of 4.10 s")
    assert page.text("[data-action=toggle]") == "Play"
    assert "driving" in page.text("[aria-label='Colors of what the robot did']")


BOXES = """[".maps canvas", ".signals", "#controls"].map((each) => {
    const box = document.querySelector(each).getBoundingClientRect();
    return [box.left, box.right, box.top, box.bottom];
})"""
CURSORS = """[...document.querySelectorAll(".cursor")].map((each) => {
    const [at, all] = [each, each.parentElement].map((one) => one.getBoundingClientRect());
    return (at.left - all.left - 52) / (all.width - 64);
})"""


def test_signals_are_beside_the_map_and_follow_its_clock(page: Page):
    page.open(t=1)
    place, signals, controls = page.browser.value(BOXES)
    assert place[1] <= signals[0] and place[2] <= signals[2] < place[3] <= controls[2]
    for key, share in (("Home", 0.0), ("c", 0.5), ("End", 1.0)):
        page.press(key)
        wait(page.browser, f"{CURSORS}.every((at) => Math.abs(at - {share}) < 0.005)")
    assert len(page.browser.value(CURSORS)) == 2
    page.press("Home")
    distance = "[data-column=goal_distance_mm]"
    wait(page.browser, f"document.querySelector('{distance}').textContent === '4.00'")
    page.press("End")
    wait(page.browser, f"document.querySelector('{distance}').textContent === '1.60'")


def test_chosen_signals_stay_for_other_runs(page: Page):
    page.open(t=0.5)
    shown = "[...document.querySelectorAll('[data-signal][open]')].map((each) => each.dataset.signal).join()"
    assert page.browser.value(shown).startswith("speed_mmps,goal_distance_mm,localization_error_mm")
    page.browser.value("document.querySelectorAll('[data-signal][open] summary').forEach((each) => each.click())")
    wait(page.browser, "/signals=none/.test(location.search)")
    page.browser.value("document.querySelector('[data-signal=goal_distance_mm] summary').click()")
    wait(page.browser, "/signals=goal_distance_mm(&|$)/.test(location.search)")
    page.press("n")
    wait(page.browser, f"document.querySelector('h1')?.textContent === {NAME + ', run 2'!r}")
    assert page.browser.value(shown) == "goal_distance_mm"
    wait(page.browser, "document.querySelector('.time')?.textContent")
    page.browser.value(
        "(() => { const s = document.querySelector('[name=withrun]'); s.value = '1'; s.dispatchEvent(new Event('change', { bubbles: true })) })()"
    )
    wait(page.browser, "document.querySelectorAll('canvas.map').length === 2")
    assert page.browser.value(shown) == "goal_distance_mm"


def test_lock_step_has_one_clock_and_the_longer_end(page: Page):
    page.open(**{"with": NAME, "withrun": 1, "t": 0.5})
    assert page.shows("0.50 s of 4.10 s")
    assert page.browser.value("document.querySelectorAll('canvas.map').length") == 2
    page.press("ArrowRight")
    assert page.shows("0.60 s")
    for map_index in (0, 1):
        assert page.color_at(1.55, 2.1, map_index) == [28, 33, 38]
    page.press("End")
    assert page.shows("4.10 s")
    assert "ended at 2.50 s" in page.text(".maps > *")
    assert page.color_at(3.35, 2.1, 0) == [28, 33, 38]  # where it ended
    assert page.color_at(4.95, 2.1, 1) == [28, 33, 38]
    assert "robot 1" not in page.text(".signals .muted")
    assert " | " in page.text(".signals .muted")


def test_lock_step_takes_a_run_of_another_campaign(page: Page):
    page.open(**{"with": "desk-1", "withrun": 0, "withc": page.earlier, "t": 2})
    assert page.shows("2.00 s of 3.10 s")
    assert f"desk-1, run 0 of {page.earlier}" in page.text(".maps")
    assert page.color_at(2.95, 2.1, 1) == [28, 33, 38]


def test_layers_come_on_request_and_report_equality(page: Page):
    page.open("executed-1", 0, t=2)
    assert page.browser.value("document.querySelectorAll('#layers input:disabled').length") == 6
    wall = page.color_at(0.5, 2.0)
    page.browser.value("document.querySelector('[data-action=execute]').click()")
    wait(page.browser, "document.querySelectorAll('#layers input:disabled').length === 0")
    assert page.text("[role=status]").startswith("The layers have a moment every 0.1 s")
    assert page.color_at(0.3, 2.0) != wall  # the global costmap
    assert page.text(".maps > *").startswith("following")


def test_foxglove_button_saves_run_as_mcap(page: Page, tmp_path: Path):
    page.open("executed-1")
    page.browser.ask("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.browser.value("document.querySelector('[data-action=foxglove]').click()")
    assert wait(page.browser, "said.textContent.startsWith('Saved as MCAP')")
    end_s = time.monotonic() + WAIT_S
    while not (saved := [*tmp_path.glob("*.mcap")]) and time.monotonic() < end_s:
        time.sleep(0.05)
    with saved[0].open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    topics = {each.topic for each in summary.channels.values()}
    assert {"/tf", "/map", "/scan", "/global_costmap/costmap"} <= topics
    assert summary.statistics.message_end_time == pytest.approx(EXECUTED_S * 1e9, abs=2e8)


def test_narrow_page_does_not_scroll_sideways(page: Page):
    page.browser.ask("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    for others in ({}, {"with": NAME, "withrun": 1}):
        page.open(t=0.5, **others)
        assert page.browser.value("document.documentElement.scrollWidth") <= 390
        place, signals, controls = page.browser.value(BOXES)
        assert place[3] <= controls[2] < controls[3] <= signals[2]  # the buttons stay near the map


def test_dark_page_draws_the_map_dark(page: Page):
    page.open(t=0.5)
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    page.browser.ask("Emulation.setEmulatedMedia", features=features)
    until = time.monotonic() + WAIT_S
    while sum(page.color_at(3.0, 1.0)) > 150:  # it is told of the change, and draws again
        assert time.monotonic() < until
        time.sleep(0.03)
    assert sum(page.color_at(0.01, 2.0)) > 450


def test_unknown_run_is_a_sentence(page: Page):
    page.browser.ask("Page.navigate", url="about:blank")
    page.browser.ask(
        "Page.navigate", url=f"{page._place}/run?{urlencode({'c': page._campaign, 'configuration': NAME, 'run': 7})}"
    )
    wait(page.browser, "document.querySelector('[role=alert]')")
    assert "expected the number of a run, 0 to 2, got 7" in page.text("[role=alert]")
    page.browser.complaints.clear()  # Chromium notes the refused request
