"""A page in a real Chromium that is on the PATH: opened, watched for complaints and requests, and closed again."""

import io
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the PATH; install one to test pages in it")
TELEPHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1200, "height": 900}

NAMELESS = """() => [...document.querySelectorAll("button, input, select, canvas, a[href], [role=region], svg")]
  .filter((one) => !one.closest("[hidden]"))
  .filter((one) => !(one.getAttribute("aria-label") || one.labels?.length || one.textContent.trim()))
  .map((one) => one.outerHTML.slice(0, 120))"""
HEADINGS = "[...document.querySelectorAll('h1, h2, h3, h4')].map((one) => Number(one.tagName[1]))"


def playwright() -> Any:
    """The library; a test module without it is skipped."""
    return pytest.importorskip("playwright.sync_api", reason="needs the extra `browser` (playwright)")


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser."""
    driver = playwright()
    driver.expect.set_options(timeout=30_000)  # [ms]: on a machine that has other work
    with driver.sync_playwright() as running:
        started = running.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        )
        yield started
        started.close()


@contextmanager
def watched(browser: Any, path: Path) -> Iterator[Callable[..., Any]]:
    """Opens a page as often as one likes; afterwards nothing may have been complained of or asked for."""
    contexts, complaints, requests = [], [], []

    def opened(viewport: dict[str, int] = DESKTOP, **options: Any) -> Any:
        contexts.append(browser.new_context(viewport=viewport, **options))
        page = contexts[-1].new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []
    assert [url for url in requests if not url.startswith(("data:", path.as_uri()))] == []


def shot(locator: Any) -> np.ndarray:
    """What is seen of an element, red, green and blue."""
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)
