#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What hostile connections cost a run that is watched.

Trains the bundled scene with --viewer, undisturbed and then with many connections of each kind, and
says how much longer training takes, how much of a core the server's threads take, how long a page
takes to come, and how long the program lives after its last file. Training is pinned to one core,
which its one thread shares with the server; the connections come from the other cores, and a process
of its own on the last core asks for the page. So the figures show what the server takes from
training, and not what the attack takes from the machine. The connections come from 127.0.0.1, and the
page is asked for from 127.0.0.2, since the server cannot tell a flood from a page that has the
flood's address. It needs Linux and two cores, and is more exact with three that are idle.

    tests/faults/connections.py --program build/default/bin/gemsplat --json connections.json
"""
import argparse
import asyncio
import http.client
import json
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

SCENE = Path(__file__).resolve().parents[2] / "examples" / "courtyard"
HEAD = b"GET /state.json HTTP/1.1\r\nHost: localhost\r\n"
PAGE = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
# kind: (said at once, said every second, whether answers are read)
KINDS = {
    "silent": (b"", b"", True),
    "a byte a second": (HEAD, b"X", True),
    "a head without an end": (HEAD + b"X: ", b"y" * 1024, True),
    "no HTTP": (bytes(range(128, 256)), b"\x00", True),
    "asks again and again": (HEAD + b"\r\n", b"", True),
    "asks and reads nothing": (PAGE, b"", False),
}


async def hold(port, kind):
    """One connection, opened again whenever it is closed, or after a minute if nothing is read."""
    first, more, reads = KINDS[kind]
    while True:
        writer = None
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
            writer.write(first)
            ended = asyncio.ensure_future(reader.read() if reads else asyncio.sleep(60))
            while not ended.done():
                await asyncio.wait([ended], timeout=1)
                writer.write(more)
                await writer.drain()
        except OSError:
            pass
        if writer:
            writer.close()
        await asyncio.sleep(0.1)


class Attack:
    """`count` connections of a kind, from a thread of their own."""

    def __init__(self, port, kind, count):
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.run, args=(port, kind, count), daemon=True)
        self.thread.start()

    def run(self, port, kind, count):
        os.sched_setaffinity(0, FLOOD_CORES)
        asyncio.set_event_loop(self.loop)
        self.loop.set_exception_handler(lambda *_: None)
        for _ in range(count):
            self.loop.create_task(hold(port, kind))
        self.loop.run_forever()

    def end(self):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        warnings.simplefilter("ignore")  # of connections that were just being opened


CORES = sorted(os.sched_getaffinity(0))
TRAINING_CORE, PROBE_CORE = {CORES[0]}, {CORES[-1]}
FLOOD_CORES = set(CORES[1:-1]) or PROBE_CORE
SERVER_NICE = 19  # of the server's threads, and of no others


def port_of(log, process):
    """The port that the program prints."""
    while process.poll() is None:
        if found := re.search(r"http://[^:/ ]+:(\d+)", log.read_text()):
            return int(found[1])
        time.sleep(0.05)
    sys.exit("the program ended before its viewer listened:\n" + log.read_text())


def page_seconds(port):
    begin = time.monotonic()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30,
                                            source_address=("127.0.0.2", 0))
    try:
        connection.request("GET", "/")
        connection.getresponse().read()
    except (OSError, http.client.HTTPException):
        return float("inf")
    finally:
        connection.close()
    return time.monotonic() - begin


def probe(port):
    """Asks for the page twice a second, and prints when each was asked for and the seconds that it
    took, until it is ended."""
    os.sched_setaffinity(0, PROBE_CORE)
    while True:
        print(time.monotonic(), end=" ", flush=True)
        print(page_seconds(port), flush=True)
        time.sleep(0.5)


class Probe:
    """probe() in a process of its own."""

    def __init__(self, port, log):
        self.log = log
        with log.open("w") as sink:
            self.process = subprocess.Popen([sys.executable, __file__, "--probe", str(port)], stdout=sink)

    def end(self, last):
        """The seconds that pages took until the moment `last`, at which the program still served. Of
        one that had not come by then, the seconds so far, if they are more than one."""
        self.process.kill()
        self.process.wait()
        pages = []
        for line in self.log.read_text().splitlines():
            begin, *seconds = map(float, line.split())
            if seconds and begin + seconds[0] <= last:
                pages.append(seconds[0])
            elif last - begin > 1:
                pages.append(last - begin)
        return pages


def server_seconds(process):
    """The time of a core that the server's threads have taken; None if the process has ended."""
    total = 0
    try:
        for task in Path(f"/proc/{process.pid}/task").iterdir():
            fields = (task / "stat").read_text().rpartition(")")[2].split()
            if int(fields[16]) == SERVER_NICE:
                total += int((task / "schedstat").read_text().split()[0]) / 1e9
    except (OSError, IndexError):
        return None
    return total


def run(program, folder, iterations, kind, count):
    log = folder / "log"
    with log.open("w") as sink:
        process = subprocess.Popen(
            [program, "train", SCENE, "-o", folder / "out", "-r", "8", "--device", "cpu", "--set",
             "train.threads=1", "--iterations", str(iterations), "--viewer", "--viewer-port", "0"],
            stdout=sink, stderr=sink, preexec_fn=lambda: os.sched_setaffinity(0, TRAINING_CORE))
    port = port_of(log, process)
    begin, server, last = time.monotonic(), 0, 0
    attack = Attack(port, kind, count) if kind else None
    pages = Probe(port, folder / "pages")
    while process.poll() is None and not (folder / "out" / "results.json").exists():
        if (seconds := server_seconds(process)) is not None:
            last = time.monotonic()
            server = seconds / (last - begin)
        time.sleep(0.2)
    asked = pages.end(last)
    end = time.monotonic()
    code = process.wait(timeout=120)
    end_seconds = time.monotonic() - end
    if attack:
        attack.end()
    if code:
        sys.exit(f"exit code {code}:\n" + log.read_text())
    results = json.loads((folder / "out" / "results.json").read_text())
    return {"training_seconds": results["train_seconds"], "server_share": server, "pages": asked,
            "end_seconds": end_seconds}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--kinds", nargs="*", help="parts of their names; none: all")
    arguments.add_argument("--connections", type=int, default=1000)
    arguments.add_argument("--iterations", type=int, default=300)
    arguments.add_argument("--repeat", type=int, default=3, help="runs of each kind; the median counts")
    arguments.add_argument("--json", type=Path, help="write the figures here, too")
    arguments = arguments.parse_args()
    if len(CORES) < 2:
        sys.exit("this needs two cores")
    kinds = [kind for kind in KINDS
             if not arguments.kinds or any(part in kind for part in arguments.kinds)]
    rows, alone = [], None
    print("| connections | training | server | page, median and worst | end |\n|---|---|---|---|---|")
    for kind in [None, *kinds]:
        runs = []
        for _ in range(arguments.repeat):
            with tempfile.TemporaryDirectory() as folder:
                runs.append(run(os.path.abspath(arguments.program), Path(folder),
                                arguments.iterations, kind, arguments.connections))
        seconds = statistics.median(one["training_seconds"] for one in runs)
        alone = alone or seconds
        pages = [page for one in runs for page in one["pages"]]
        rows.append({"kind": kind or "none", "training": seconds / alone,
                     "server": statistics.median(one["server_share"] for one in runs),
                     "page_median": statistics.median(pages or [math.inf]),
                     "page_worst": max(pages, default=math.inf),
                     "end": max(one["end_seconds"] for one in runs), "runs": runs})
        row = rows[-1]
        print(f"| {row['kind']} | {100 * row['training']:.1f} % | {100 * row['server']:.1f} % | "
              f"{row['page_median']:.2f} s, "
              f"{row['page_worst']:.2f} s | {row['end']:.1f} s |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--probe"]:
        probe(int(sys.argv[2]))
    main()
