"""A headless Chromium for the pages: errors and requests of a page fail its test."""

# Tests wait for what they look at (`resized`, `wait_for_function`) or for drawn frames, never for a time.

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from aerobat_pin.numerics import Array
from aerobat_pin.visualization.replay.snapshots import BROWSER_FLAGS, BROWSERS, SEEK_AND_DRAW

CHROMIUM = next((path for name in BROWSERS if (path := shutil.which(name))), None)
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine: install it, e.g. `apt-get install chromium`"
)

PATIENCE = 120_000.0  # [ms]: what takes longer hangs


@contextmanager
def started() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=BROWSER_FLAGS, timeout=PATIENCE)
        yield running
        running.close()


@contextmanager
def opened(browser: Any, address: str, *allowed: str, size: tuple[int, int] = (1000, 650)) -> Iterator[Any]:
    """Open a page of a size [px]; fail if it errs, or requests what is no file, no data and at no allowed address."""
    page = browser.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
    page.set_default_timeout(PATIENCE)
    problems: list[str] = []
    requests: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    try:
        page.goto(address)
        yield page
        assert problems == []
        assert [url for url in requests if not url.startswith(("file:", "data:", *allowed))] == []
    finally:
        page.close()  # a page of a failed test would play on and keep a core busy


def ready(page: Any) -> None:
    """Wait until a replay plays."""
    page.wait_for_function("window.viewer && viewer.animator.time > 0.005")


def frames(page: Any) -> None:
    """Wait until the page has drawn what has changed: two frames."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def resized(page: Any, width: int, height: int) -> None:
    """Resize the window [px], and wait until the page has noticed; events of a frame come before it is drawn."""
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_function("([width, height]) => innerWidth === width && innerHeight === height", arg=[width, height])
    frames(page)


def at(page: Any, time: float) -> None:
    """Pause a replay at a time [s]."""
    page.evaluate("viewer.animator.pause()")
    page.evaluate(SEEK_AND_DRAW, time)


def node(page: Any, *path: str) -> Any:
    """Return position, quaternion and scale of a node below `world`."""
    find = f"viewer.scene_tree.find({['meshcat', 'world', *path]}).object"
    return {name: page.evaluate(f"{find}.{name}.toArray()") for name in ("position", "quaternion", "scale")}


def pixels(page: Any) -> Array:
    """Return what is drawn behind legend and controls (height, width, 3), from 0 to 1."""
    style = page.add_style_tag(content=".panel, .dg { display: none !important; }")
    image = imread(io.BytesIO(page.screenshot()))[..., :3]
    style.evaluate("(element) => element.remove()")
    return np.asarray(image)
