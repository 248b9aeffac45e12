# SPDX-License-Identifier: Apache-2.0
"""Somebody who looks at the page of `view` or `train --viewer` while the campaigns disturb the
program: a thread that reads the address from the program's output and asks it for what a browser
would."""

import re
import signal
import threading
import time
import urllib.error
import urllib.request

WAITS = 10  # seconds for one answer, and for a pause
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/")
SECRET = re.compile(r"#control=([0-9a-f]+)")


class Visitor(threading.Thread):
    """Visits until the process has ended. It never fails: what it meets is the campaign's matter."""

    def __init__(self, process, outputs, what, stops=False):
        super().__init__(daemon=True)
        self.process, self.outputs, self.what, self.stops = process, outputs, what, stops

    def run(self):
        while not ADDRESS.search(self.text()):
            if self.process.poll() is not None:
                return
            time.sleep(0.005)
        if self.what == "look":
            self.look()
        else:
            self.control()

    def text(self):
        return "".join(path.read_text(errors="replace") for path in self.outputs)

    def ask(self, path, token=None):
        """The body of the answer, or nothing."""
        request = urllib.request.Request(ADDRESS.search(self.text()).group() + path,
                                         method="POST" if token else "GET",
                                         headers={"X-Control-Token": token} if token else {})
        try:
            with urllib.request.urlopen(request, timeout=WAITS) as answer:
                return answer.read().decode(errors="replace")
        except (OSError, ValueError, urllib.error.URLError):
            return ""

    def look(self):
        for path in ("scene.json", "model", "photo/0"):
            self.ask(path)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)

    def control(self):
        """Pauses the run, saves its model, and lets it go on or stops it."""
        secret = SECRET.search(self.text())
        if not secret:
            return
        self.ask("control?do=pause", secret.group(1))
        end = time.monotonic() + WAITS
        while self.process.poll() is None and time.monotonic() < end:
            if not (state := self.ask("state.json")) or '"paused":true' in state.replace(" ", ""):
                break
        for word in ("save", "stop" if self.stops else "resume"):
            self.ask(f"control?do={word}", secret.group(1))
