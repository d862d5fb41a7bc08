"""Campaign and configuration in a real browser: filter, brush, reload, back, keyboard, narrow and dark."""

import base64
import io
import subprocess
import sys
import time

import numpy as np
import pytest
from chromium import CHROMIUM, chromium, opened
from PIL import Image

from vastflow.oracles.evidence.wide import wide_table, write_wide
from vastflow.oracles.results.tables import read_tables

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")]

PATIENCE_S = 60
EVIL = "<img src=x onerror=alert(1)>"
KEYS = {"ArrowDown": 40, "ArrowRight": 39, "ArrowUp": 38, "Enter": 13, "+": 187}
SHOWN = "document.documentElement?.dataset.shown"


@pytest.fixture
def campaign(add_campaign, id_of):
    """A campaign with a number that differs in each run, and a family whose name is HTML; its id."""
    directory = add_campaign(3, {EVIL: [0, 1], "hard": [4, 2]})
    runs = wide_table(read_tables(directory))
    runs["distance_m"] = np.linspace(0.0, 15.0, len(runs))
    write_wide(directory, runs)
    return id_of(directory)


@pytest.fixture
def page(tmp_path, results, campaign):
    """A browser at the campaign's page, whose pages must not complain; and the explorer's address."""
    command = [sys.executable, "-m", "vastflow.flows.cli", "ui", str(results), "--no-browser"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server,
        chromium(tmp_path / "chromium") as address,
    ):
        try:
            browser = opened(address)
            browser.ask("Emulation.setDeviceMetricsOverride", width=1300, height=900, deviceScaleFactor=1, mobile=False)
            visit(browser, server.stdout.readline().strip())
            visit(browser, f"{browser.value('location.origin')}/campaign?c={campaign}")
            until(browser, f"{SHOWN} === '1'")
            yield browser
            assert browser.complaints == []
        finally:
            server.terminate()
            server.wait(PATIENCE_S)


def visit(browser, address):
    browser.ask("Page.navigate", url=address)
    until(browser, "document.readyState === 'complete' && location.protocol === 'http:'")


def until(browser, expression):
    """Wait until an expression of JavaScript is true."""
    end_s = time.monotonic() + PATIENCE_S
    while not browser.value(f"Boolean({expression})"):
        assert time.monotonic() < end_s, f"{expression}: {browser.value('document.body.innerText')}"
        time.sleep(0.05)


def press(browser, key, *, shift=False):
    own = {"key": key, "windowsVirtualKeyCode": KEYS[key], **({"text": "\r"} if key == "Enter" else {})}
    own["modifiers"] = 8 if shift else 0
    browser.ask("Input.dispatchKeyEvent", type="keyDown", **own)
    browser.ask("Input.dispatchKeyEvent", type="keyUp", **own)


def drag(browser, element, start, end):
    """Drag over an element, from one share of its width and height to another."""
    browser.value(f"{element}.scrollIntoView({{block: 'center'}})")
    x, y, width, height = browser.value(
        f"(() => {{ const box = {element}.getBoundingClientRect(); return [box.x, box.y, box.width, box.height]; }})()"
    )
    places = [{"x": x + share[0] * width, "y": y + share[1] * height} for share in (start, end)]
    mouse = {"button": "left", "clickCount": 1}
    browser.ask("Input.dispatchMouseEvent", type="mouseMoved", **places[0])
    browser.ask("Input.dispatchMouseEvent", type="mousePressed", **places[0], **mouse)
    browser.ask("Input.dispatchMouseEvent", type="mouseMoved", **places[1], **mouse, buttons=1)
    browser.ask("Input.dispatchMouseEvent", type="mouseReleased", **places[1], **mouse)


def chips(browser):
    return browser.value("[...document.querySelectorAll('.chip')].map(each => each.textContent)")


def painted(browser):
    """Number of pixels of the map on the screen that do not have the most frequent color, its ground's."""
    x, y, width, height = browser.value(
        "(() => { const map = document.querySelector('.map'); map.scrollIntoView({block: 'center'});"
        "const box = map.getBoundingClientRect(); return [box.x + scrollX, box.y + scrollY, box.width, box.height]; })()"
    )
    clip = {"x": x, "y": y, "width": width, "height": height, "scale": 1}
    taken = browser.ask("Page.captureScreenshot", format="png", clip=clip)["data"]
    picture = Image.open(io.BytesIO(base64.b64decode(taken))).convert("RGB")
    return picture.width * picture.height - max(n for n, _ in picture.getcolors(1 << 24))


def until_painted(browser):
    """Wait until the map shows its floor and all runs."""
    until(browser, "/[1-9]\\d* recorded runs/.test(document.querySelector('#map').textContent)")
    assert painted(browser) > 500


def test_selection_survives_reload_and_back_button(page):
    box = "[...document.querySelectorAll('.facet')].find(each => each.querySelector('h3').textContent === 'passed')"
    page.value(f"{box}.querySelectorAll('input')[1].click()")
    until(page, "document.querySelector('.chip')")
    assert chips(page) == ["passed: fail ✕"]
    until(page, f"{SHOWN} === '2'")
    assert page.value("document.activeElement.dataset.key") in (None, "passed fail")
    drag(page, "document.querySelector('.histogram')", (0.01, 0.5), (0.9, 0.5))
    until(page, f"{SHOWN} === '3' && document.querySelectorAll('.chip').length === 2")
    assert chips(page)[0].startswith("distance_m: 0.")
    text, place = page.value("document.getElementById('summary').innerText"), page.value("location.href")
    assert "distance_m" in place
    visit(page, place)
    until(page, f"{SHOWN} === '1'")
    assert page.value("document.getElementById('summary').innerText") == text
    until_painted(page)
    page.value("document.querySelector('#table tbody a').click()")
    until(page, f"location.pathname === '/configuration' && {SHOWN} === '1'")
    page.value("history.back()")
    until(page, "location.pathname === '/campaign' && document.querySelectorAll('.chip').length === 2")
    assert page.value("location.href") == place
    page.value(
        "[...document.querySelectorAll('button')].find(each => each.textContent === 'Clear all filters').click()"
    )
    until(page, "!document.querySelector('.chip') && !location.search.includes('f=')")


def test_configuration_shows_runs_signals_and_neighbor(page, campaign):
    address = f"{page.value('location.origin')}/configuration?c={campaign}"
    visit(page, f"{address}&name=hard-2")
    until(page, f"{SHOWN} === '1'")
    assert page.value("document.querySelectorAll('#runs tbody tr').length") == 4
    assert page.value("document.querySelector('#runs a').href").endswith(
        f"/run?c={campaign}&configuration=hard-2&run=0"
    )
    until_painted(page)
    assert page.value("document.querySelectorAll('#signals path.line').length") == 3
    page.value("const pick = document.querySelectorAll('#signals select')[1]; pick.value = 'distance_m';"
               "pick.dispatchEvent(new Event('change', {bubbles: true}))")  # fmt: skip
    until(page, "location.search.includes('over=distance_m')")
    until(page, "document.querySelector('#signals svg.chart').ariaLabel.includes('distance')")
    assert page.value("document.querySelector('#neighbor h2').textContent") == "Nearest configuration that passes"
    assert page.value("document.querySelector('#neighbor a').textContent") == f"{EVIL}-1"
    page.value("document.querySelector('#neighbor a').click()")
    until(page, f"document.querySelector('h1')?.textContent === {f'{EVIL}-1'!r} && {SHOWN} === '1'")
    assert page.value("document.querySelector('#neighbor h2').textContent") == "Nearest configuration that fails"


def test_failed_paths_cover_others_in_their_own_color(page):
    until_painted(page)
    drawn = page.value(
        "[...document.querySelectorAll('#map svg.map path[d]:not([d=\"\"])')].map(each => {"
        "const {stroke, opacity} = getComputedStyle(each); return [each.getAttribute('class'), stroke, Number(opacity)]; })"
    )
    runs = [each for each in drawn if each[0] in ("pass", "fail")]
    assert [name for name, *_ in runs] == ["pass", "fail"]
    assert runs[1] == ["fail", "rgb(194, 84, 0)", 0.9]  # not blended to the gray of runs that were not judged


def test_map_dashes_runs_that_were_not_judged_below_others(page):
    until_painted(page)
    drawn = page.value(
        "[...document.querySelectorAll('#map svg path')].filter(each => /pass|fail|judged/.test(each.classList))"
        ".map(each => [String(each.classList), each.getAttribute('stroke-dasharray')])"
    )
    assert drawn == [["not-judged", "5 4"], ["pass", None], ["fail", None]]
    assert page.value("/\\d recorded runs on/.test(document.querySelector('#map').innerText)")
    assert page.value("/\\d runs/.test(document.getElementById('summary').innerText)")


def test_table_and_map_are_used_by_keyboard(page):
    page.value("document.querySelector('#table [tabindex=\"0\"]').focus()")
    press(page, "ArrowDown")
    press(page, "ArrowRight")
    assert page.value("document.activeElement.closest('td').cellIndex") == 1
    assert page.value("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert page.value("document.querySelectorAll('#table table [tabindex=\"0\"]').length") == 1
    page.value("document.querySelector('.map').focus()")
    until_painted(page)
    before = painted(page)
    press(page, "+")
    assert painted(page) != before
    page.value("document.querySelectorAll('#table tbody a')[0].focus()")
    press(page, "Enter")
    until(page, f"location.pathname === '/configuration' && {SHOWN} === '1'")


def test_charts_select_runs_and_are_saved(page):
    until_painted(page)
    page.value("window.saved = []; const make = URL.createObjectURL;"
               "URL.createObjectURL = (blob) => { window.saved.push(blob.type); return make(blob); };")  # fmt: skip
    for name in ("scatter", "parallel", "python"):
        page.value(f"document.getElementById('{name}').open = true")
    until(page, "document.querySelector('#scatter svg.chart') && document.querySelector('#parallel svg.chart')")
    until(page, "document.querySelector('#python pre').textContent.includes('pd.read_parquet')")
    assert "open=scatter%2Cparallel%2Cpython" in page.value("location.search")
    for kind in ("map", "scatter", "parallel"):
        page.value(
            f"document.querySelectorAll('#{kind} button').forEach(each => /PNG|SVG/.test(each.textContent) && each.click())"
        )
    until(page, "window.saved.filter(type => type === 'image/png').length === 3")
    assert page.value("window.saved.filter(type => type === 'image/svg+xml').length") >= 3
    drag(page, "document.querySelector('#parallel .handle')", (0.5, 0.02), (0.5, 0.98))
    until(page, f"{SHOWN} === '2'")
    assert [chip.split(":")[0] for chip in chips(page)] == ["noise"]
    drag(page, "document.querySelector('#scatter svg.chart')", (0.2, 0.1), (0.95, 0.8))
    until(page, f"{SHOWN} === '3'")
    assert [chip.split(":")[0] for chip in chips(page)] == ["noise", "success.distance (m)"]


def test_charts_are_brushed_by_keyboard(page):
    for name in ("scatter", "parallel"):
        page.value(f"document.getElementById('{name}').open = true")
    until(page, "document.querySelector('#scatter svg.chart') && document.querySelector('#parallel svg.chart')")
    page.value("document.querySelector('#parallel .handle').focus()")
    for _ in range(9):
        press(page, "ArrowUp")
    press(page, "ArrowDown", shift=True)
    press(page, "Enter")
    until(page, f"{SHOWN} === '2'")
    assert [chip.split(":")[0] for chip in chips(page)] == ["noise"]
    page.value("document.querySelector('#scatter svg.chart').focus()")
    assert page.value("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    for key in ("ArrowRight", "ArrowUp", "ArrowUp"):
        press(page, key)
    for _ in range(8):
        press(page, "ArrowDown", shift=True)
    press(page, "Enter")
    until(page, f"{SHOWN} === '3'")
    assert [chip.split(":")[0] for chip in chips(page)] == ["noise", "success.distance (m)"]
    assert page.value("document.activeElement.dataset.key") == "scatter"


@pytest.mark.parametrize("dark", [False, True])
def test_pages_fit_390_pixels(page, campaign, dark):
    page.ask("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    page.ask("Emulation.setEmulatedMedia", features=features)
    origin = page.value("location.origin")
    for address in (
        f"/campaign?c={campaign}&open=scatter,parallel,python&f=passed%3Dfail",
        f"/configuration?c={campaign}&name=hard-1",
    ):
        visit(page, origin + address)
        until(page, f"{SHOWN} === '1'")
        page.value("for (const each of document.querySelectorAll('details')) each.open = true")
        assert page.value("document.documentElement.scrollWidth") <= 390


def test_reasons_are_not_cut_beside_the_map(page, campaign):
    page.ask("Emulation.setDeviceMetricsOverride", width=1200, height=900, deviceScaleFactor=1, mobile=False)
    visit(page, f"{page.value('location.origin')}/campaign?c={campaign}")
    until(page, f"{SHOWN} === '1'")
    assert "stuck" in page.value("document.querySelector('#why').innerText")
    assert page.value("(why => why.scrollWidth - why.clientWidth)(document.querySelector('#why'))") == 0


def test_wrong_filter_is_reported_and_can_be_cleared(page, campaign):
    visit(page, f"{page.value('location.origin')}/campaign?c={campaign}&f=nothing%3D1")
    until(page, "document.querySelector('#error .sentence')")
    assert page.value("document.querySelector('#error').innerText").startswith("expected a column of this campaign")
    page.complaints.clear()  # the browser's own words about the replies
    page.value("document.querySelector('#error button').click()")
    until(page, "document.querySelector('#summary b') && !document.querySelector('#error').childElementCount")
