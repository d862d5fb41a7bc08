"""Chromium, driven by its debugging protocol."""

import json
import shutil
import subprocess
import time
import urllib.request
from contextlib import contextmanager

from websockets.sync.client import connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"),
    *("--no-first-run", "--remote-debugging-port=0", "--remote-allow-origins=*"),
)


class Browser:
    """A page in Chromium, by its debugging protocol."""

    def __init__(self, address):
        self._socket = connect(address, max_size=None, ping_interval=None)
        self._next = 0
        self.complaints = []

    def ask(self, method, **parameters):
        """Send a command and wait for its answer; what the page complains of meanwhile is kept."""
        self._next += 1
        self._socket.send(json.dumps({"id": self._next, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=120))
            self._note(message)
            if message.get("id") == self._next:
                return message["result"]

    def value(self, expression):
        """Value of an expression of JavaScript in the page."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def open(self, file):
        """Load a page, and wait until it is loaded with all its pictures."""
        self.ask("Page.navigate", url="about:blank")  # so that the page before, if it was this one, is not taken for it
        self.ask("Page.navigate", url=file.absolute().as_uri())
        until = time.monotonic() + 120
        while self.value("document.readyState + location.protocol") != "completefile:":
            assert time.monotonic() < until, "the page was not loaded within two minutes"
            time.sleep(0.05)

    def _note(self, message):
        told = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(told["exceptionDetails"]))
        elif message.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(told["entry"]["text"])
        elif message.get("method") == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(str(told["args"]))


@contextmanager
def chromium(profile):
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


def opened(address):
    """A browser that tells what a page complains of."""
    browser = Browser(address)
    for domain in ("Page", "Runtime", "Log"):
        browser.ask(f"{domain}.enable")
    return browser
