"""Browsers without a window, to open pages and to ask them: Chromium, spoken to through two pipes, Firefox, and WebKit,
of which Safari is made."""

import base64
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any, Self

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
WEBKIT_DRIVER, DISPLAY_SERVER = shutil.which("WebKitWebDriver"), shutil.which("Xvfb")
WEBKIT = next(iter(Path("/usr/lib").glob("*/webkit2gtk-4.*/MiniBrowser")), None)
WEBKIT_PORT = 28_282  # of its driver, for one test at a time
MARIONETTE_PORT = 28_281  # of Firefox, for one test at a time
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--remote-debugging-pipe",
    "--allow-file-access-from-files",
)
SOUND_AT_ONCE = "--autoplay-policy=no-user-gesture-required"  # not only after a click or a touch


class Browser:
    """Chromium with one page. Use it in a `with` statement."""

    def __init__(self, folder: Path, size: tuple[int, int] = (1200, 900), options: tuple[str, ...] = ()) -> None:
        to_browser, from_browser = os.pipe(), os.pipe()
        window = f"--window-size={size[0]},{size[1]}"
        read_end, write_end = to_browser[0], from_browser[1]

        def use_pipes() -> None:  # Chromium reads from 3 and writes to 4
            a, b = os.dup(read_end), os.dup(write_end)
            os.dup2(a, 3)
            os.dup2(b, 4)

        self._process = subprocess.Popen(
            [str(CHROMIUM), *OPTIONS, *options, window, f"--user-data-dir={folder}", "about:blank"],
            preexec_fn=use_pipes,
            close_fds=False,
            stderr=subprocess.DEVNULL,
        )
        os.close(read_end), os.close(write_end)
        self._out, self._in = os.fdopen(to_browser[1], "wb"), os.fdopen(from_browser[0], "rb")
        self._number, self._session, self._rest = 0, "", b""
        self.errors: list[str] = []  # of the page's scripts
        self.requests: list[str] = []  # to anywhere
        target = next(t for t in self._call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self._call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._out.close()
        self._in.close()

    def open(self, path: Path, fragment: str = "") -> None:
        """Open a page from disk, and wait until it is loaded. fragment: the end of its address, which begins with #"""
        self._call("Page.navigate", url=path.absolute().as_uri() + fragment)
        while self.ask("document.readyState") != "complete":
            pass

    def ask(self, expression: str) -> Any:
        """Return the value of an expression of the page's script, of a promise when it is kept."""
        asked = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in asked:
            raise RuntimeError(json.dumps(asked["exceptionDetails"])[:1000])
        return asked["result"].get("value")

    def render(self, frames: int, messages: str) -> str:
        """Return what the page plays, as its `fdh.render` does."""
        return str(self.ask(f"fdh.render({frames}, {json.dumps(messages)})"))

    def emulate(self, width: int, height: int, is_dark: bool = False, is_forced: bool = False) -> None:
        """Let the page believe in a window of this size, in a dark room, and in colours that the system forces."""
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if is_dark else "light"}
        colours = {"name": "forced-colors", "value": "active" if is_forced else "none"}
        self._call("Emulation.setEmulatedMedia", features=[scheme, colours])

    def key(self, kind: str, code: str, key: str, modifiers: int = 0) -> None:
        """Let a key of the computer go down or up. kind: keyDown | keyUp; modifiers: 1 Alt, 2 Ctrl, 4 Meta, 8 Shift"""
        text = {"text": key} if kind == "keyDown" and len(key) == 1 and not modifiers & 7 else {}
        self._call("Input.dispatchKeyEvent", type=kind, code=code, key=key, modifiers=modifiers, **text)

    def mouse(self, kind: str, x: float, y: float, button: str = "left") -> None:
        """Move the mouse, or its button. kind: mousePressed | mouseReleased | mouseMoved"""
        held = 0 if kind == "mouseReleased" else {"left": 1, "right": 2}[button]
        self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=held, clickCount=1)

    def fingers(self, kind: str, *places: tuple[float, float]) -> None:
        """Move fingers on the screen. kind: touchStart | touchMove | touchEnd; places: of all that touch it"""
        points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(places)]
        self._call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def roles(self) -> list[dict[str, Any]]:
        """Return the accessibility tree of the page, as a list."""
        return list(self._call("Accessibility.getFullAXTree")["nodes"])

    def touch(self, selector: str) -> None:
        """Touch an element of the page with a finger for a while."""
        place = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        x, y = self.ask(f"(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])({place})")
        self._call("Emulation.setTouchEmulationEnabled", enabled=True)
        for kind, points in (("touchStart", [{"x": x, "y": y}]), ("touchEnd", [])):
            self._call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
            time.sleep(0.2)

    def picture(self) -> bytes:
        """Return a picture of the whole page, PNG."""
        return base64.b64decode(self._call("Page.captureScreenshot", captureBeyondViewport=True)["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._out.write(json.dumps(message).encode() + b"\0")
        self._out.flush()
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in.fileno(), 1 << 20)
            if not part:
                raise RuntimeError("the browser has ended")
            self._rest += part
        text, _, self._rest = self._rest.partition(b"\0")
        message = json.loads(text)
        method, given = message.get("method"), message.get("params", {})
        is_error = method == "Log.entryAdded" and given["entry"]["level"] == "error"
        if method == "Runtime.exceptionThrown" or is_error:
            self.errors.append(json.dumps(given)[:1000])
        elif method == "Network.requestWillBeSent":
            self.requests.append(given["request"]["url"][:200])
        return dict(message)


class Firefox:
    """Firefox with one page, spoken to in its own protocol (Marionette). Use it in a `with` statement."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        (folder / "user.js").write_text(f'user_pref("marionette.port", {MARIONETTE_PORT});\n')
        command = [str(FIREFOX), "--headless", "--marionette", "--profile", str(folder)]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._socket, self._rest, self._number = self._connect(), b"", 0
        self._next()
        self._call("WebDriver:NewSession", {})
        self._call("WebDriver:SetTimeouts", {"script": 60_000})

    def _connect(self) -> socket.socket:
        for _ in range(300):
            try:
                return socket.create_connection(("127.0.0.1", MARIONETTE_PORT))
            except OSError:
                time.sleep(0.1)
        raise RuntimeError("Firefox does not answer")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._process.kill()
        self._process.wait()

    def open(self, path: Path) -> None:
        """Open a page from disk, and wait until it is loaded."""
        self._call("WebDriver:Navigate", {"url": path.absolute().as_uri()})

    def render(self, frames: int, messages: str) -> str:
        """Return what the page plays, as its `fdh.render` does."""
        script = "const [frames, text, done] = arguments, { fdh } = window.wrappedJSObject ?? window;"
        script += " fdh.render(frames, text).then(done, error => done(String(error)));"
        return str(self._call("WebDriver:ExecuteAsyncScript", {"script": script, "args": [frames, messages]})["value"])

    def _call(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._number += 1
        message = json.dumps([0, self._number, method, parameters]).encode()
        self._socket.sendall(str(len(message)).encode() + b":" + message)
        _, _, error, value = self._next()
        if error is not None:
            raise RuntimeError(f"{method}: {str(error)[:1000]}")
        return dict(value or {})

    def _next(self) -> Any:
        """Return the next message: its length, a colon, and JSON."""
        while b":" not in self._rest or len(self._rest) < self._end():
            part = self._socket.recv(1 << 20)
            if not part:
                raise RuntimeError("Firefox has ended")
            self._rest += part
        end = self._end()
        message, self._rest = self._rest[self._rest.index(b":") + 1 : end], self._rest[end:]
        return json.loads(message)

    def _end(self) -> int:
        length, _, _ = self._rest.partition(b":")
        return len(length) + 1 + int(length)


class WebKit:
    """WebKit with one page, on a display of its own, spoken to as the W3C's WebDriver says. Use it in a `with`
    statement."""

    def __init__(self) -> None:
        read_end, write_end = os.pipe()
        server = [str(DISPLAY_SERVER), "-displayfd", str(write_end)]
        self._server = subprocess.Popen(server, pass_fds=[write_end], stderr=subprocess.DEVNULL)
        os.close(write_end)
        with os.fdopen(read_end) as told:
            display = f":{told.readline().strip()}"
        driver = [str(WEBKIT_DRIVER), f"--port={WEBKIT_PORT}"]
        self._driver = subprocess.Popen(driver, env=os.environ | {"DISPLAY": display}, stderr=subprocess.DEVNULL)
        self._session = ""
        options = {"binary": str(WEBKIT), "args": ["--automation"]}
        wanted = {"capabilities": {"alwaysMatch": {"webkitgtk:browserOptions": options}}}
        self._session = f"/session/{self._first_answer('/session', wanted)['sessionId']}"
        self._call("/timeouts", {"script": 60_000})

    def _first_answer(self, path: str, body: dict[str, Any]) -> Any:
        for _ in range(300):
            try:
                return self._call(path, body)
            except urllib.error.URLError:
                time.sleep(0.1)
        raise RuntimeError("WebKit does not answer")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._call("", {}, "DELETE")
        finally:
            for process in (self._driver, self._server):
                process.kill()
                process.wait()

    def open(self, path: Path) -> None:
        """Open a page from disk, and wait until it is loaded."""
        self._call("/url", {"url": path.absolute().as_uri()})

    def ask(self, expression: str) -> Any:
        """Return the value of an expression of the page's script, of a promise when it is kept."""
        script = "const done = arguments[0]; Promise.resolve().then(() => (EXPRESSION))"
        script += ".then(done, error => done(String(error)));"
        return self._call("/execute/async", {"script": script.replace("EXPRESSION", expression), "args": []})

    def render(self, frames: int, messages: str) -> str:
        """Return what the page plays, as its `fdh.render` does."""
        return str(self.ask(f"fdh.render({frames}, {json.dumps(messages)})"))

    def click(self, selector: str) -> None:
        """Click on an element of the page, as a hand does."""
        element = self._call("/element", {"using": "css selector", "value": selector})
        self._call(f"/element/{next(iter(element.values()))}/click", {})

    def _call(self, path: str, body: dict[str, Any], method: str = "POST") -> Any:
        url = f"http://127.0.0.1:{WEBKIT_PORT}{self._session}{path}"
        request = urllib.request.Request(url, json.dumps(body).encode(), {"Content-Type": "application/json"})
        request.method = method
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)["value"]
