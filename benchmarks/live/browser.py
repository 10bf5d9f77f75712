# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window, over its DevTools protocol: what tests and benchmark need of it."""

from __future__ import annotations

import base64
import io
import itertools
import json
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from matplotlib.image import imread
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks import children
from benchmarks.children import BenchError
from hapticmech_ros.graph.processes import stop_process
from hapticmech_ros.live.page import BACKGROUND

Found = TypeVar("Found")

PATIENCE_S = 90.0
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--window-size=1000,700",
    "--remote-debugging-port=0",
)
# Addresses that do not leave the browser.
INSIDE = ("data:", "blob:", "chrome:", "about:", "devtools:")


def chromium() -> str | None:
    """Return where Chromium is; None if it is not installed."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


def wait_until(found: Callable[[], Found], what: str) -> Found:
    """Return the first true value of a function.

    Raises:
        BenchError: there is none for long.
    """
    return children.wait_until(found, PATIENCE_S, what, look_again_s=0.02)


class Browser:
    """A browser of its own, with nothing kept from others.

    Args:
        folder: for what it keeps.

    Raises:
        BenchError: it is not installed, or does not start.
    """

    def __init__(self, folder: Path) -> None:
        if (program := chromium()) is None:
            raise BenchError("Chromium is not installed: apt install chromium")
        command = [program, *FLAGS, f"--user-data-dir={folder}", "about:blank"]
        self._process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
        )
        told = folder / "DevToolsActivePort"

        def lines() -> list[str]:
            found = told.read_text(encoding="utf-8").splitlines() if told.is_file() else []
            return found if len(found) > 1 else []

        self._port, self._path = wait_until(lines, "Chromium's port")[:2]
        self._pages: list[Page] = []

    def page(self) -> Page:
        """Return a new tab."""
        control = Connection(f"ws://127.0.0.1:{self._port}{self._path}")
        target = control.call("Target.createTarget", url="about:blank")["targetId"]
        control.close()
        page = Page(target, f"ws://127.0.0.1:{self._port}/devtools/page/{target}")
        self._pages.append(page)
        return page

    def close(self) -> None:
        """End it."""
        for page in self._pages:
            page.connection.close()
        stop_process(self._process)


class Connection:
    """Calls, and events that are collected."""

    def __init__(self, address: str) -> None:
        self._socket = connect(address, max_size=None, compression=None)
        self._numbers = itertools.count(1)
        self._answers: dict[int, Any] = {}
        self._came = threading.Condition()
        self.events: list[dict[str, Any]] = []
        self._end = float("inf")
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def call(self, method: str, **parameters: Any) -> Any:
        """Return what a method answers.

        Raises:
            BenchError: it fails, or does not answer.
        """
        number = self._send(method, params=parameters)
        with self._came:
            self._came.wait_for(
                lambda: number in self._answers or self._end < float("inf"), PATIENCE_S
            )
            answer = self._answers.pop(number, {"error": "no answer"})
        if "error" in answer:
            raise BenchError(f"{method}: {answer['error']}")
        return answer["result"]

    def ended(self) -> float:
        """Return when the other side closed it, once it has; never, if that takes long."""
        self._thread.join(PATIENCE_S)
        return self._end

    def close(self) -> None:
        """Close it."""
        self._socket.close()
        self._thread.join()

    def _listen(self) -> None:
        while True:
            try:
                text = self._socket.recv()
            except ConnectionClosed:  # by either side, or with the browser
                with self._came:
                    self._end = time.monotonic()
                    self._came.notify_all()
                return
            message = json.loads(text)
            with self._came:
                if "id" in message:
                    self._answers[message["id"]] = message
                else:
                    self.events.append(message)
                self._came.notify_all()
            if message.get("method") == "Target.attachedToTarget":
                # A worker waits until it is watched.
                session = message["params"]["sessionId"]
                self._send("Network.enable", sessionId=session)
                self._send("Runtime.runIfWaitingForDebugger", sessionId=session)

    def _send(self, method: str, **more: object) -> int:
        """Send a call, and return its number."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, **more}))
        return number


class Page:
    """A tab."""

    def __init__(self, target: str, address: str) -> None:
        self.target = target
        self.connection = Connection(address)
        for domain in ("Page", "Runtime", "Network"):
            self.connection.call(f"{domain}.enable")
        self.connection.call(
            "Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True, flatten=True
        )

    def close(self) -> None:
        """Close the tab, as somebody who clicks on its cross."""
        with suppress(BenchError, ConnectionClosed):  # it may be gone before it answers
            self.connection.call("Page.close")

    def prepare(self, script: str) -> None:
        """Run a script in every document before its own."""
        self.connection.call("Page.addScriptToEvaluateOnNewDocument", source=script)

    def open(self, address: str) -> None:
        """Go to an address."""
        self.connection.call("Page.navigate", url=address)

    def ask(self, expression: str) -> Any:
        """Return the value of an expression in the page.

        Raises:
            BenchError: it has none.
        """
        answer = self.connection.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise BenchError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def text(self, element: str) -> str:
        """Return the text of an element by its id; empty if there is none."""
        return str(self.ask(f"document.getElementById({element!r})?.textContent ?? ''"))

    def wait_for_text(self, element: str, wanted: str) -> None:
        """Wait until an element has a text."""
        wait_until(lambda: self.text(element) == wanted, f"{element} to be {wanted!r}")

    def mouse(self, kind: str, x: float, y: float, pressed: bool = False) -> None:
        """Do ``mousePressed``, ``mouseMoved`` or ``mouseReleased`` with the left button."""
        self.connection.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button="left" if pressed or kind != "mouseMoved" else "none",
            buttons=int(pressed),
            clickCount=1,
            pointerType="mouse",
        )

    def click(self, x: float, y: float) -> None:
        """Click there."""
        self.mouse("mouseMoved", x, y)
        self.mouse("mousePressed", x, y, pressed=True)
        self.mouse("mouseReleased", x, y)

    def click_text(self, tag: str, words: str) -> None:
        """Click an element with this tag, and these words alone."""
        # Where it is, if two pictures later it is still there: folders open slowly.
        wanted = (
            f"(() => {{ const at = () => {{ const e = [...document.querySelectorAll({tag!r})]"
            f".filter(e => e.textContent.trim() === {words!r} && e.getClientRects().length)[0];"
            " if (!e) return null; e.scrollIntoView({block: 'center'});"
            " const r = e.getBoundingClientRect();"
            " return [r.x + r.width / 2, r.y + r.height / 2]; };"
            " const first = at(), later = requestAnimationFrame;"
            " return new Promise(done => later(() => later(() => {"
            " const last = at(); done(last && `${first}` === `${last}` ? last : null); }))); })()"
        )
        x, y = wait_until(lambda: self.ask(wanted), f"{tag} {words!r}")
        self.click(x, y)

    def nudge(self, label: str) -> None:
        """Move the slider with a label up by its smallest step."""
        slider = "document.querySelectorAll('[role=slider]')"
        wanted = (
            f"(() => {{ const l = [...document.querySelectorAll('*')].filter("
            f"e => e.textContent.trim() === {label!r} && e.getClientRects().length).pop();"
            " if (!l) return null; l.scrollIntoView({block: 'center'});"
            f" const y = l.getBoundingClientRect().y;"
            f" const s = [...{slider}].sort((a, b) => Math.abs(a.getBoundingClientRect().y - y)"
            " - Math.abs(b.getBoundingClientRect().y - y))[0]; s.focus(); return true; })()"
        )
        wait_until(lambda: self.ask(wanted), label)
        for kind in ("keyDown", "keyUp"):
            self.connection.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key="ArrowRight",
                code="ArrowRight",
                windowsVirtualKeyCode=39,
            )

    def is_drawn(self, x: float, y: float) -> bool:
        """Return whether a pixel has neither the background's colour nor the ground's."""
        clip = {"x": x, "y": y, "width": 1, "height": 1, "scale": 1}
        taken = self.connection.call("Page.captureScreenshot", format="png", clip=clip)
        picture = imread(io.BytesIO(base64.b64decode(taken["data"])))
        return bool((abs(picture[..., :3] - np.array(BACKGROUND) / 255.0) > 0.2).any())

    def addresses(self) -> set[str]:
        """Return all addresses that were asked for, websockets included."""
        found = set()
        for event in list(self.connection.events):
            name, values = event["method"], event["params"]
            if name == "Network.requestWillBeSent":
                found.add(values["request"]["url"])
            elif name == "Network.webSocketCreated":
                found.add(values["url"])
        return {one for one in found if not one.startswith(INSIDE)}
