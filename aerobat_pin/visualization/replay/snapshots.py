"""Take pictures of a replay at given times with a headless browser."""

from __future__ import annotations

import shutil
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

from aerobat_pin.errors import BrowserError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Chromium has no sandbox for root; it needs none, as it opens only our page. SwiftShader draws without a GPU.
BROWSER_FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PICTURE_SIZE = (1280, 720)  # pixels
BROWSER_ADVICE = (
    "`pip install 'aerobat-pinocchio[frames]'` and a Chromium, e.g. `apt-get install chromium` or "
    "`playwright install chromium`"
)
CLOCK_ALONE = (  # style sheet that hides all controls except the clock
    "#controls > :not(#clock), .dg { display: none !important; } #controls { right: auto !important; } "
    "#legend { bottom: 1rem !important; }"
)
SEEK_AND_DRAW = (
    "time => new Promise((done) => { seek(time); requestAnimationFrame(() => requestAnimationFrame(done)); })"
)


def snapshots(
    page: str, times: Iterable[float], size: tuple[int, int] = PICTURE_SIZE, *, controls: bool = False
) -> Iterator[bytes]:
    """Take pictures of a replay; yields the content of a PNG file for each time.

    Args:
        page: HTML of a replay.
        times: times since the start of the replay [s].
        size: width and height of the pictures [pixels].
        controls: show the time bar and its buttons; if False, only the time is shown, in a corner.

    Raises:
        BrowserError: Playwright or Chromium is not installed, or the browser fails to draw.
    """
    # Playwright runs in a separate thread: it refuses to start where an event loop already runs, as in a notebook.
    with ThreadPoolExecutor(max_workers=1) as thread:
        pictures = _take_pictures(page, times, size, controls)
        try:
            while (picture := thread.submit(next, pictures, None).result()) is not None:
                yield picture
        finally:
            thread.submit(pictures.close).result()


def _take_pictures(
    page: str, times: Iterable[float], size: tuple[int, int], controls: bool
) -> Generator[bytes, None, None]:
    """Take the pictures for `snapshots`, in the thread that calls this function."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise BrowserError(f"pictures of a replay take a browser: {BROWSER_ADVICE}") from error
    installed = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=installed, args=BROWSER_FLAGS)
        except Error as error:
            raise BrowserError(f"pictures of a replay take a browser, and none starts: {BROWSER_ADVICE}") from error
        try:
            tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
            tab.set_content(page)
            if not controls:
                tab.add_style_tag(content=CLOCK_ALONE)
            tab.wait_for_function("window.viewer")
            if not controls:
                tab.evaluate("viewer.camera.clearViewOffset()")
            tab.evaluate("viewer.animator.pause()")
            for time in times:
                tab.evaluate(SEEK_AND_DRAW, time)
                yield tab.screenshot()
        except Error as error:
            raise BrowserError(f"the browser draws nothing: {error.message.splitlines()[0]}") from error
        finally:
            browser.close()
