"""A headless Chromium, asked over its DevTools protocol: opens pages, runs JavaScript, clicks, takes pictures."""

import base64
import json
import shutil
import subprocess
import time
from pathlib import Path

import requests
import websocket

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
]


def chromium() -> str | None:
    """The browser's program, if there is one."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


def wait_for(what, seconds: float, words: str):
    """The first true answer of `what()`; an error that says for what it waited."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if answer := what():
            return answer
        time.sleep(0.2)
    raise TimeoutError(f"{words}: not within {seconds:.0f} s")


class Browser:
    """One page; a context that ends its process.

    Args:
        folder: for the profile.
        width, height: of the window [pixels].
    """

    def __init__(self, folder: Path, width: int = 1200, height: int = 1600):
        profile = folder / "profile"
        size = f"--window-size={width},{height}"
        command = [chromium(), *QUIET, size, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port_file = profile / "DevToolsActivePort"
        lines = wait_for(lambda: port_file.exists() and port_file.read_text().split(), 60, "Chromium")
        pages = requests.get(f"http://127.0.0.1:{lines[0]}/json", timeout=30).json()
        address = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")
        self._socket = websocket.create_connection(address, timeout=300)
        self._number = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()
        self._process.terminate()
        self._process.wait(30)

    def call(self, method: str, **arguments) -> dict:
        """One call of the protocol and its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": arguments}))
        while True:
            answer = json.loads(self._socket.recv())
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def ask(self, script: str):
        """The value of a JavaScript expression; a promise is waited for."""
        found = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def open(self, address: str) -> None:
        """Go to a page."""
        self.call("Page.navigate", url=address)

    def place(self, script: str) -> dict:
        """x, y, width, height [pixels] in the window of an element, after it was scrolled into view."""
        self.ask(f"({script}).scrollIntoView({{block: 'center'}})")
        time.sleep(0.5)
        names = "({x: r.x, y: r.y, width: r.width, height: r.height})"
        return self.ask(f"(() => {{ const r = ({script}).getBoundingClientRect(); return {names}; }})()")

    def click(self, script: str, across: float = 0.5) -> None:
        """Press the mouse on an element, at a share of its width."""
        at = self.place(script)
        spot = {
            "x": at["x"] + across * at["width"],
            "y": at["y"] + 0.5 * at["height"],
            "button": "left",
            "clickCount": 1,
        }
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, **spot)

    def picture(self, clip: dict | None = None) -> bytes:
        """PNG of the window, or of a rectangle in it."""
        more = {"clip": {**clip, "scale": 1}} if clip else {}
        return base64.b64decode(self.call("Page.captureScreenshot", format="png", **more)["data"])
