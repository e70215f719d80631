"""Pictures of a replay at given times, taken by a browser that nobody sees."""

from __future__ import annotations

import shutil
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

from aerobat_pin.errors import BrowserError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Without a sandbox, which root is not given, for it opens nothing but our own page; drawn by the processor.
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = (1280, 720)  # pixels
ADVICE = (
    "`pip install 'aerobat-pinocchio[frames]'` and a Chromium, e.g. `apt-get install chromium` or "
    "`playwright install chromium`"
)
BARE = (  # the clock alone, in its corner
    "#controls > :not(#clock), .dg { display: none !important; } #controls { right: auto !important; } "
    "#legend { bottom: 1rem !important; }"
)
DRAWN = "time => new Promise((done) => { seek(time); requestAnimationFrame(() => requestAnimationFrame(done)); })"


def snapshots(
    page: str, times: Iterable[float], size: tuple[int, int] = SIZE, *, controls: bool = False
) -> Iterator[bytes]:
    """Yield a PNG file per time.

    Args:
        page: HTML of a recording.
        times: since its start [s].
        size: width and height [pixels].
        controls: show the time bar and its buttons; else the time alone, in a corner.

    Raises:
        BrowserError: there is no Playwright or no Chromium here, or it draws nothing.
    """
    # In a thread of its own: where an event loop already runs, as in a notebook, Playwright refuses to start.
    with ThreadPoolExecutor(max_workers=1) as thread:
        pictures = _taken(page, times, size, controls)
        try:
            while (picture := thread.submit(next, pictures, None).result()) is not None:
                yield picture
        finally:
            thread.submit(pictures.close).result()


def _taken(page: str, times: Iterable[float], size: tuple[int, int], controls: bool) -> Generator[bytes, None, None]:
    """Do what `snapshots` does, all in the thread that asks for the first picture."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise BrowserError(f"pictures of a replay take a browser: {ADVICE}") from error
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=found, args=FLAGS)
        except Error as error:
            raise BrowserError(f"pictures of a replay take a browser, and none starts: {ADVICE}") from error
        try:
            tab = browser.new_page(viewport={"width": size[0], "height": size[1]})
            tab.set_content(page)
            if not controls:
                tab.add_style_tag(content=BARE)
            tab.wait_for_function("window.viewer")
            if not controls:
                tab.evaluate("viewer.camera.clearViewOffset()")
            tab.evaluate("viewer.animator.pause()")
            for time in times:
                tab.evaluate(DRAWN, time)
                yield tab.screenshot()
        except Error as error:
            raise BrowserError(f"the browser draws nothing: {error.message.splitlines()[0]}") from error
        finally:
            browser.close()
