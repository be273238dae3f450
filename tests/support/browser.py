"""A headless browser: Debian's Chromium, or the one that playwright has installed."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


class NoBrowser(RuntimeError):
    """No browser can be started; the message says why."""


@contextmanager
def chromium() -> Iterator[Any]:
    """raises: NoBrowser"""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        raise NoBrowser("playwright is not installed (extra dev)") from None
    installed = next(filter(None, map(shutil.which, NAMES)), None)
    with sync_playwright() as playwright:
        try:
            # In a container there is neither a sandbox nor a graphics card.
            browser = playwright.chromium.launch(executable_path=installed, args=["--no-sandbox", "--disable-gpu"])
        except Error as error:
            what = str(error).splitlines()[0]
            raise NoBrowser(f"no Chromium starts ({what}); `playwright install chromium`, or apt install it") from None
        try:
            yield browser
        finally:
            browser.close()


ROLES = {
    "button",
    "checkbox",
    "combobox",
    "image",
    "link",
    "listbox",
    "slider",
    "spinbutton",
    "textbox",
    "Canvas",
    "Iframe",
}


def nameless(tab: Any) -> list[str]:
    """Roles of controls and pictures that have no name for a screen reader; [] if all have one."""
    nodes = tab.context.new_cdp_session(tab).send("Accessibility.getFullAXTree")["nodes"]
    seen = [node for node in nodes if not node["ignored"] and node["role"]["value"] in ROLES]
    return [node["role"]["value"] for node in seen if not node.get("name", {}).get("value", "").strip()]


def until(tab: Any, expression: str, argument: Any = None, timeout: float = 15.0) -> None:
    """Wait until an expression is true on a page; playwright's own wait needs `eval`, which these pages forbid."""
    begun = time.monotonic()
    while not tab.evaluate(expression, argument):
        if time.monotonic() - begun > timeout:
            raise TimeoutError(f"not within {timeout:g} s: {expression}")
        tab.wait_for_timeout(20)
