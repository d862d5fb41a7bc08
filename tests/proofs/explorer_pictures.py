"""Make the docs' pictures of the explorer, from two campaign directories of the quickstart.

    python tests/proofs/explorer_pictures.py BASELINE CANDIDATE CONFIGURATION RUN [--to docs/images]

CONFIGURATION and RUN name a failed run of CANDIDATE, which is filmed as well.
"""

import argparse
import base64
import io
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

import uvicorn
from PIL import Image

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from chromium import chromium, opened  # type: ignore[import-not-found]

WIDTH, HEIGHT = 1400, 900
COLORS: Final = 128
FILM_WIDTH: Final = 900
COMPLETE: Final = """document.readyState === "complete" && location.href !== "about:blank"
    && (document.querySelector("[data-action=execute]")?.hidden ?? true)
    && !document.body.innerText.includes("Read so far:")
    && (document.documentElement.dataset.shown || !document.querySelector('[src$="/campaign.js"], [src$="/configuration.js"]'))
"""
"""Whether a page has all that it asks the server for: a run its layers, other pages their views."""
FILM: Final = range(30)
"""Seconds of the filmed run, a picture each."""


@contextmanager
def served(roots: list[Path]) -> Iterator[tuple[str, Directories]]:
    """Serve the explorer of some folders, and yield its address and what it found."""
    directories = Directories(roots)
    config = uvicorn.Config(application(directories, "pictures"), host="127.0.0.1", port=0, log_level="error")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until = time.monotonic() + 30
    while not server.started:
        assert time.monotonic() < until, "the server did not start within half a minute"
        time.sleep(0.05)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}", directories
    finally:
        server.should_exit = True
        thread.join(30)


def picture(browser: Any, address: str, wait_s: float) -> Image.Image:
    """Open an address and return what it shows when it is complete; complaints of the page are errors."""
    browser.ask("Page.navigate", url="about:blank")
    browser.ask("Page.navigate", url=address)
    until = time.monotonic() + wait_s
    while not browser.value(COMPLETE):
        assert time.monotonic() < until, f"{address} was not complete within {wait_s:g} s"
        time.sleep(0.1)
    time.sleep(0.5)  # to be painted
    assert not browser.complaints, browser.complaints
    return Image.open(io.BytesIO(base64.b64decode(browser.ask("Page.captureScreenshot", format="png")["data"])))


def save(image: Image.Image, file: Path) -> None:
    """Write a picture with few colors, which takes a third of the bytes."""
    image.convert("RGB").quantize(COLORS).save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Write the six views and the film."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("baseline", type=Path)
    parser.add_argument("candidate", type=Path)
    parser.add_argument("configuration")
    parser.add_argument("run", type=int)
    parser.add_argument("--to", type=Path, default=Path("docs/images"))
    parser.add_argument("--wait", type=float, default=120.0, help="seconds in which a page must be complete")
    asked = parser.parse_args()
    asked.to.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as profile,
        served([asked.baseline, asked.candidate]) as (root, directories),
        chromium(Path(profile)) as page,
    ):
        browser = opened(page)
        ids = {each.path: each.id for each in directories.all()}
        before, after = (ids[path.resolve()] for path in (asked.baseline, asked.candidate))
        run = {"c": after, "configuration": asked.configuration, "run": asked.run, "t": 20, "paused": 1, "layers": 1}
        views = {
            "campaigns": "/",
            "comparison": f"/compare?{urlencode({'a': before, 'b': after})}",
            "campaign": f"/campaign?{urlencode({'c': after, 'f': 'passed=fail'})}",
            "configuration": f"/configuration?{urlencode({'c': after, 'name': asked.configuration})}",
            "run": f"/run?{urlencode(run)}",
            "lock-step": f"/run?{urlencode({**run, 'with': asked.configuration, 'withrun': asked.run + 1})}",
        }
        browser.ask("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
        browser.ask("Page.navigate", url=f"{root}/?token=pictures")
        time.sleep(2)
        for name, address in views.items():
            save(picture(browser, root + address, asked.wait), asked.to / f"explorer-{name}.png")
        frames: list[Image.Image] = []
        for t_s in FILM:
            image = picture(browser, f"{root}/run?{urlencode({**run, 't': t_s})}", asked.wait)
            frames.append(image.convert("RGB").resize((FILM_WIDTH, HEIGHT * FILM_WIDTH // WIDTH)))
        film = asked.to / "explorer.webp"
        frames[0].save(film, save_all=True, append_images=frames[1:], duration=250, loop=0, quality=50, method=6)
        print(f"{film}: {film.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
