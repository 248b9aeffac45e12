#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What hostile connections cost a run that is watched.

Trains the bundled scene with --viewer, undisturbed and then with many connections of each kind, and
says how much longer a step takes, how long a page takes to come, and how long the program lives
after its last file. Training is pinned to one core and has one thread; the connections come from
the other cores. So the figures show what the server takes from training, and not what the attack
takes from the machine. The connections come from 127.0.0.1, and the page is asked for from
127.0.0.2, since the server cannot tell a flood from a page that has the flood's address. It needs
Linux and two cores.

    tests/faults/connections.py --program build/default/bin/gemsplat
"""
import argparse
import asyncio
import http.client
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
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
        os.sched_setaffinity(0, OTHER_CORES)
        asyncio.set_event_loop(self.loop)
        self.loop.set_exception_handler(lambda *_: None)
        for _ in range(count):
            self.loop.create_task(hold(port, kind))
        self.loop.run_forever()

    def end(self):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()


CORES = sorted(os.sched_getaffinity(0))
TRAINING_CORE, OTHER_CORES = {CORES[0]}, set(CORES[1:])


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


def run(program, folder, iterations, kind, count):
    log = folder / "log"
    with log.open("w") as sink:
        process = subprocess.Popen(
            [program, "train", SCENE, "-o", folder / "out", "-r", "8", "--device", "cpu", "--set",
             "train.threads=1", "--iterations", str(iterations), "--viewer", "--viewer-port", "0"],
            stdout=sink, stderr=sink, preexec_fn=lambda: os.sched_setaffinity(0, TRAINING_CORE))
    port = port_of(log, process)
    attack = Attack(port, kind, count) if kind else None
    pages = []
    while process.poll() is None and not (folder / "out" / "results.json").exists():
        seconds = page_seconds(port)
        if process.poll() is None:  # it has not ended meanwhile
            pages.append(seconds)
        time.sleep(0.5)
    begin = time.monotonic()
    code = process.wait(timeout=120)
    end_seconds = time.monotonic() - begin
    if attack:
        attack.end()
    if code:
        sys.exit(f"exit code {code}:\n" + log.read_text())
    results = json.loads((folder / "out" / "results.json").read_text())
    return {"training_seconds": results["train_seconds"], "pages": pages, "end_seconds": end_seconds}


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--connections", type=int, default=1000)
    arguments.add_argument("--iterations", type=int, default=300)
    arguments.add_argument("--repeat", type=int, default=3, help="runs of each kind; the median counts")
    arguments.add_argument("--json", type=Path, help="write the figures here, too")
    arguments = arguments.parse_args()
    if not OTHER_CORES:
        sys.exit("this needs two cores")
    rows, alone = [], None
    print("| connections | training | page, median and worst | end |\n|---|---|---|---|")
    for kind in [None, *KINDS]:
        runs = []
        for _ in range(arguments.repeat):
            with tempfile.TemporaryDirectory() as folder:
                runs.append(run(os.path.abspath(arguments.program), Path(folder),
                                arguments.iterations, kind, arguments.connections))
        seconds = statistics.median(one["training_seconds"] for one in runs)
        alone = alone or seconds
        pages = [page for one in runs for page in one["pages"]]
        rows.append({"kind": kind or "none", "training": seconds / alone,
                     "page_median": statistics.median(pages), "page_worst": max(pages),
                     "end": max(one["end_seconds"] for one in runs), "runs": runs})
        row = rows[-1]
        print(f"| {row['kind']} | {100 * row['training']:.1f} % | {row['page_median']:.2f} s, "
              f"{row['page_worst']:.2f} s | {row['end']:.1f} s |", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
