"""Measure a report in Chromium: height, visible words, and position of the first pictures.

Exit code 1 where a limit is not met. With --pictures, screenshots in light and dark, 1,300 and 390 px wide.

    python tests/proofs/report_page.py REPORT [--most-px 9000] [--most-words 2000] [--pictures FOLDER]
"""

import argparse
import base64
import itertools
import json
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from websockets.sync.client import connect

CHROMIUM: Final = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET: Final = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"),
    *("--no-first-run", "--remote-debugging-port=0", "--remote-allow-origins=*"),
)
WIDTH, PHONE = 1300, 390
SCREEN: Final = 900
MOST_FIRST_PICTURE_PX, MOST_WORST_PX, MOST_FIRST_FOLD_PX = 1500, 3500, 3 * SCREEN
STRIP: Final = 2600
"""Height of a screenshot; a longer page has several."""


class Browser:
    """A page in Chromium, by its debugging protocol."""

    def __init__(self, address: str) -> None:
        self._socket = connect(address, max_size=None, ping_interval=None)
        self._next = 0
        self.complaints: list[str] = []

    def ask(self, method: str, **parameters: Any) -> Any:
        """Send a command and wait for its answer; what the page complains of meanwhile is kept."""
        self._next += 1
        self._socket.send(json.dumps({"id": self._next, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=120))
            self._note(message)
            if message.get("id") == self._next:
                return message["result"]

    def value(self, expression: str) -> Any:
        """Value of an expression of JavaScript in the page."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def open(self, file: Path) -> None:
        """Load a page, and wait until it is loaded with all its pictures."""
        self.ask("Page.navigate", url="about:blank")  # so that the page before, if it was this one, is not taken for it
        self.ask("Page.navigate", url=file.absolute().as_uri())
        until = time.monotonic() + 120
        while self.value("document.readyState + location.protocol") != "completefile:":
            assert time.monotonic() < until, "the page was not loaded within two minutes"
            time.sleep(0.05)

    def size(self, width: int, height: int = SCREEN) -> None:
        """Give the page a window; a narrow one is a phone's."""
        self.ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )

    def _note(self, message: dict[str, Any]) -> None:
        told = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(told["exceptionDetails"]))
        elif message.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(told["entry"]["text"])
        elif message.get("method") == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(str(told["args"]))


@contextmanager
def chromium(profile: Path) -> Iterator[str]:
    """Start Chromium with its files in `profile`, and yield its address."""
    assert CHROMIUM is not None
    process = subprocess.Popen(
        [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        port = profile / "DevToolsActivePort"
        until = time.monotonic() + 120
        while not (port.is_file() and port.read_text().count("\n")):
            assert process.poll() is None, f"Chromium ended with {process.poll()} before it listened"
            assert time.monotonic() < until, "Chromium did not listen within two minutes"
            time.sleep(0.05)
        with urllib.request.urlopen(f"http://127.0.0.1:{port.read_text().splitlines()[0]}/json") as answer:
            pages = [page for page in json.load(answer) if page["type"] == "page"]
        yield pages[0]["webSocketDebuggerUrl"]
    finally:
        process.terminate()
        process.wait(60)


def opened(address: str) -> Browser:
    """A browser that tells what a page complains of."""
    browser = Browser(address)
    for domain in ("Page", "Runtime", "Log"):
        browser.ask(f"{domain}.enable")
    return browser


def measured(browser: Browser, report: Path) -> dict[str, float | None]:
    """Measures of a report opened at `WIDTH`: px from the top, visible words, megabytes.

    None for the places of what it doesn't have.
    """
    browser.size(WIDTH)
    browser.open(report)
    top = "(it => it ? Math.round(it.getBoundingClientRect().top + scrollY) : null)(document.querySelector(%r))"
    return {
        "height_px": browser.value("document.documentElement.scrollHeight"),
        "words": browser.value("document.querySelector('main').innerText.split(/\\s+/).filter(Boolean).length"),
        "first_picture_px": browser.value(top % "img"),
        "worst_px": browser.value(top % "#worst .case"),
        "first_fold_px": browser.value(top % "details"),
        "size_mb": round(report.stat().st_size / 1e6, 2),
    }


def beyond(found: Mapping[str, float | None], most_px: float, most_words: float) -> list[str]:
    """Return the measures that exceed their limits."""
    limits = {
        "height_px": most_px,
        "words": most_words,
        "first_picture_px": MOST_FIRST_PICTURE_PX,
        "worst_px": MOST_WORST_PX,
        "first_fold_px": MOST_FIRST_FOLD_PX,
        "size_mb": 20.0,
    }
    return [f"{name} {found[name]} > {most}" for name, most in limits.items() if (found[name] or 0) > most]


def photograph(browser: Browser, report: Path, folder: Path) -> None:
    """Screenshots of the page as it is opened, from the top down."""
    folder.mkdir(parents=True, exist_ok=True)
    for width, scheme in itertools.product((WIDTH, PHONE), ("light", "dark")):
        browser.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.size(width)
        browser.open(report)
        height = browser.value("document.documentElement.scrollHeight")
        for k, y in enumerate(range(0, height, STRIP)):
            clip = {"x": 0, "y": y, "width": width, "height": min(STRIP, height - y), "scale": 1}
            found = browser.ask("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
            (folder / f"{width}-{scheme}-{k}.png").write_bytes(base64.b64decode(found["data"]))


def main() -> int:
    """Open, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path)
    parser.add_argument("--most-px", type=float, default=9000)
    parser.add_argument("--most-words", type=float, default=2000)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as address:
        browser = opened(address)
        found = measured(browser, arguments.report)
        if arguments.pictures:
            photograph(browser, arguments.report, arguments.pictures)
    print(json.dumps(found))
    wrong = beyond(found, arguments.most_px, arguments.most_words)
    print("\n".join(wrong) or "within the limits")
    return 1 if wrong or browser.complaints else 0


if __name__ == "__main__":
    sys.exit(main())
