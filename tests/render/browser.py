"""A real browser for the tests: headless Chromium, driven through its DevTools protocol over a pipe.

No package is needed for this: Chromium reads commands from file descriptor 3 and answers on 4, JSON ended by a zero
byte (`--remote-debugging-pipe`).
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time

import cv2
import numpy as np

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def chromium():
    """Path of the browser, or None."""
    return os.environ.get("COSPEECH_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One page of a headless Chromium. `log` collects what the page printed, threw or could not load; `requests` the
    addresses it asked for."""

    def __init__(self, profile, size=(1280, 720)):
        self._in, answers = os.pipe()
        commands, self._out = os.pipe()
        self._rest, self._count = b"", 0
        self.log, self.requests, self.session = [], [], None

        def wire():  # in the child: copies first, so that neither end is overwritten while it moves to 3 or 4
            ends = os.dup(commands), os.dup(answers)
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        options = [
            "--headless=new",
            "--remote-debugging-pipe",
            "--no-sandbox",
            "--disable-gpu",
            "--mute-audio",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--disable-background-networking",
            f"--user-data-dir={profile}",
            f"--window-size={size[0]},{size[1]}",
            "--force-device-scale-factor=1",
            "about:blank",
        ]
        self.process = subprocess.Popen(
            [chromium(), *options],
            preexec_fn=wire,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        targets = self.send("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self.session = self.send("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")
        width, height = size
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)
        os.close(self._in)
        os.close(self._out)

    def send(self, method, **parameters):
        """Run one command and return its result."""
        self._count += 1
        number = self._count
        message = {"id": number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        rest = json.dumps(message).encode() + b"\0"
        while rest:
            rest = rest[os.write(self._out, rest) :]
        deadline = time.monotonic() + 60
        while True:
            answer = self._read(deadline)
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer}"
                return answer["result"]
            self._heard(answer)

    def _read(self, deadline):
        while b"\0" not in self._rest:
            ready = select.select([self._in], [], [], max(deadline - time.monotonic(), 0))[0]
            chunk = os.read(self._in, 1 << 20) if ready else b""
            assert chunk, "the browser does not answer"
            self._rest += chunk
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def _heard(self, event):
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"][:200])
        elif method == "Runtime.exceptionThrown":
            self.log.append(json.dumps(parameters["exceptionDetails"])[:1000])
        elif method in ("Runtime.consoleAPICalled", "Log.entryAdded"):
            self.log.append(json.dumps(parameters)[:1000])

    def open(self, path):
        """Open a file of this machine."""
        self.send("Page.navigate", url=f"file://{path}")
        self.wait("document.readyState === 'complete'")

    def run(self, script):
        """The value of a JavaScript expression, which may be a promise; what it throws fails the test."""
        answer = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition, seconds=30):
        """Until a JavaScript expression holds."""
        deadline = time.monotonic() + seconds
        while not self.run(f"Boolean({condition})"):
            assert time.monotonic() < deadline, f"never came true: {condition}"
            time.sleep(0.05)

    def click(self, selector):
        """Press the left button in the middle of an element, as a user's hand would."""
        x, y = self.run(
            f"(({{left, top, width, height}}) => [left + width / 2, top + height / 2])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def mouse(self, kind, x, y, **more):
        """A mouse event at x, y (CSS pixels): mousePressed, mouseMoved, mouseReleased, mouseWheel."""
        button = {} if kind == "mouseWheel" else {"button": "left", "clickCount": 1, "buttons": 1}
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **(button | more))

    def key(self, key, code, number, text=""):
        """Press and release a key."""
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, code=code, windowsVirtualKeyCode=number, text=text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, code=code, windowsVirtualKeyCode=number)

    def screenshot(self, path=None):
        """The page as it looks, (H, W, 3) uint8 BGR; also written to `path`."""
        raw = base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"])
        if path:
            path.write_bytes(raw)
        return cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)
