"""A real Chromium, controlled through its driver (Debian: chromium, chromium-driver). Nothing is
downloaded."""

import json
import shutil
from collections.abc import Callable
from typing import Any

import pytest
from tests.rigs.processes import until

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
needs_chromium = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="no chromium with chromedriver on this machine"
)
PATIENCE_S = 90.0
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
    # it looks for updates and accounts at every start, which takes minutes to fail on a closed
    # network
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-quic", "--no-first-run"),
)


class Chromium:
    """One window. `ask` runs JavaScript."""

    def __init__(self, width: int = 1280, height: int = 1200, *more: str) -> None:
        """more: options of Chromium."""
        from selenium.webdriver import Chrome, ChromeOptions
        from selenium.webdriver.chrome.service import Service as Driver

        options = ChromeOptions()
        options.binary_location = CHROMIUM
        for option in (*OPTIONS, f"--window-size={width},{height}", *more):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.chrome = Chrome(options=options, service=Driver(DRIVER))

    def ask(self, script: str) -> Any:
        """Return the value of a JavaScript expression."""
        return self.chrome.execute_script(f"return {script}")

    def text(self, element: str) -> str:
        """Return the text of an element."""
        return str(self.ask(f"document.getElementById({json.dumps(element)}).textContent"))

    def write(self, element: str, text: str) -> None:
        """Type text into a field, as a person does."""
        field = self.chrome.find_element("id", element)
        field.clear()
        field.send_keys(text)

    def click(self, element: str) -> None:
        """Click an element, as a person does."""
        self.chrome.find_element("id", element).click()

    def until(self, what: str, check: Callable[[], Any]) -> Any:
        """Poll until the check is true; return its value."""
        return until(check, PATIENCE_S, what)

    def complaints(self) -> list[str]:
        """Return the errors that the page caused in the browser's console."""
        return [str(line["message"]) for line in self.chrome.get_log("browser")]

    def close(self) -> None:
        """End the browser."""
        self.chrome.quit()
