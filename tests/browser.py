"""A headless Chromium, driven over pipes by the DevTools protocol: pages are opened, clicked, typed into and read."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs a chromium binary on PATH")

TIMEOUT = 60.0
"""Seconds for an answer of the browser, or for a page to be ready."""

_QUIET = [f"--disable-{name}" for name in ("gpu", "quic", "background-networking", "component-update", "sync")]
_KEYS = {"ArrowDown": 40, "ArrowUp": 38, "Enter": 13, "Escape": 27, "Tab": 9, "Home": 36, "End": 35}


class BrowserError(Exception):
    """A script of a page failed, or the browser refused a command."""


class Browser:
    """One page of a browser; `errors` are complaints of its scripts and its security policy, `requests` addresses."""

    def __init__(self, process: subprocess.Popen[bytes], to_browser: int, from_browser: int) -> None:
        self.process = process
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._to, self._from = to_browser, os.fdopen(from_browser, "rb", closefd=False)
        self._numbers, self._waiting, self._session, self._context = itertools.count(1), b"", "", ""
        self.renew()

    def renew(self, downloads: Path | None = None) -> Browser:
        """Open a blank page with a storage of its own in the place of the last one, and a folder of downloads."""
        self._session = ""
        if self._context:
            self.send("Target.disposeBrowserContext", browserContextId=self._context)
        self._context = self.send("Target.createBrowserContext")["browserContextId"]
        target = self.send("Target.createTarget", url="about:blank", browserContextId=self._context)["targetId"]
        if downloads is not None:
            place = {"downloadPath": str(downloads), "browserContextId": self._context}
            self.send("Browser.setDownloadBehavior", behavior="allow", **place)
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.errors, self.requests = [], []
        return self

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """The result of a command of the protocol."""
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            answer = self._next_message()
            if answer.get("id") == number:
                if "error" in answer:
                    raise BrowserError(f"{method}: {answer['error']}")
                return answer["result"]
            self._note(answer)
        raise BrowserError(f"{method}: no answer within {TIMEOUT:g} s")

    def _next_message(self) -> dict[str, Any]:
        while b"\0" not in self._waiting:
            read = self._from.read1(1 << 20)
            if not read:
                raise BrowserError("the browser has ended")
            self._waiting += read
        message, self._waiting = self._waiting.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        """Remember what went wrong, and what was asked of the network."""
        params = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                self.errors.append(str(params["exceptionDetails"].get("exception", params)))
            case "Log.entryAdded" if params["entry"]["level"] == "error":
                self.errors.append(params["entry"]["text"])
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])

    def open(self, url: str | Path) -> None:
        """Open a page, or a file, and wait until it is ready."""
        self.send("Page.navigate", url=url.resolve().as_uri() if isinstance(url, Path) else url)
        self.wait("location.href !== 'about:blank'")

    def reload(self) -> None:
        """Load the page again, with what it has written to the storage.

        A busy Chromium may hand the storage to the next page late, or not at all: here it is handed over by a script.
        """
        stored = self.evaluate("JSON.stringify(Object.entries(localStorage))")
        script = f"for (const [name, value] of {stored}) localStorage.setItem(name, value);"
        added = self.send("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        self.evaluate("window.isOld = true")
        self.send("Page.reload")
        self.wait("!window.isOld")
        self.send("Page.removeScriptToEvaluateOnNewDocument", identifier=added)

    def evaluate(self, code: str) -> Any:
        """The value of an expression in the page, or what its promise gives."""
        found = self.send("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise BrowserError(f"{code}: {found['exceptionDetails'].get('exception', {}).get('description')}")
        return found["result"].get("value")

    def wait(self, code: str) -> None:
        """Wait until an expression is true of a page that has loaded and run its scripts, perhaps after another one."""
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            try:
                if self.evaluate(f"document.readyState === 'complete' && ({code})"):
                    return
            except BrowserError:
                self.process.poll()
            time.sleep(0.02)
        raise BrowserError(f"{code}: not true within {TIMEOUT:g} s")

    def text(self, selector: str) -> str:
        """What a reader sees of the first element that a selector names."""
        return self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")

    def click(self, selector: str) -> None:
        """Click the middle of an element with the mouse, once nothing above it is still to be drawn."""
        self.wait("document.querySelector('[aria-busy]') === null")
        one = f"document.querySelector({json.dumps(selector)})"
        self.evaluate(f"{one}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        x, y = self.evaluate(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({one}.getBoundingClientRect())")
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, *keys: str) -> None:
        """Press keys: a letter, or a name such as ArrowDown."""
        for key in keys:
            letter = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
            code = _KEYS.get(key, ord(key.upper()[0]))
            self.send("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, **letter)
            self.send("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)

    def type(self, selector: str, text: str) -> None:
        """Type a text into a field, in the place of what it holds."""
        self.evaluate(f"document.querySelector({json.dumps(selector)}).select()")
        self.send("Input.insertText", text=text)

    def resize(self, width: int, height: int, dark: bool = False, media: str = "") -> None:
        """Make the page so large, light or dark, for the screen or, with "print", for paper."""
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", media=media, features=[scheme])


@contextmanager
def browsing(profile: Path) -> Iterator[Browser]:
    """A browser with its profile in a folder; it ends with the block."""
    assert CHROMIUM is not None
    (read_commands, to_browser), (from_browser, write_answers) = os.pipe(), os.pipe()
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--no-first-run", "--remote-debugging-pipe", *_QUIET]
    command += [f"--user-data-dir={profile}", "--window-size=1280,900", "--hide-scrollbars"]

    def as_3_and_4() -> None:
        # Copies first, because either may be 3 or 4 itself.
        low, high = os.dup(read_commands), os.dup(write_answers)
        os.dup2(low, 3)
        os.dup2(high, 4)

    process = subprocess.Popen(
        command, pass_fds=(3, 4), preexec_fn=as_3_and_4, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    os.close(read_commands)
    os.close(write_answers)
    try:
        yield Browser(process, to_browser, from_browser)
    finally:
        process.terminate()
        process.wait(30)
        os.close(to_browser)
        os.close(from_browser)
