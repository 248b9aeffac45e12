#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What hostile connections cost a run that is watched.

Trains the bundled scene with --viewer, one run for each kind of connection. Connections come and go
by turns of some seconds, so that each turn with them is compared with the turns without them before
and after it: a machine that is slower for a minute, or a model that grows, changes all three. The
figures are how fast training is with the connections, how much of a core the server's threads take,
how long a page takes to come, and how long the program lives after SIGTERM.

Training is pinned to one core, which its one thread shares with the server; the connections come from
the other cores, and a process of its own on the last core asks for the page, with and without the
connections. So the figures show what the server takes from training, and not what the attack takes
from the machine. The connections come from 127.0.0.1, and the page is asked for from 127.0.0.2,
since the server cannot tell a flood from a page that has the flood's address. It needs Linux and two
cores, and is more exact with three that are idle.

    tests/faults/connections.py --program build/default/bin/gemsplat --json connections.json
"""
import argparse
import asyncio
import http.client
import json
import math
import os
import re
import signal
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
    "none": None,  # what the method shows where nothing comes
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
        finally:
            if writer:
                writer.transport.abort()  # without waiting for what was not sent
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
        tasks = [self.loop.create_task(hold(port, kind)) for _ in range(count if KINDS[kind] else 0)]
        self.loop.run_forever()
        for task in tasks:
            task.cancel()
        self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self.loop.close()

    def end(self):
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        warnings.simplefilter("ignore")  # of connections that were just being opened


CORES = sorted(os.sched_getaffinity(0))
TRAINING_CORE, PROBE_CORE = {CORES[0]}, {CORES[-1]}
FLOOD_CORES = set(CORES[1:-1]) or PROBE_CORE
SERVER_NICE = 19  # of the server's threads, and of no others
SETTLING_SECONDS = 1.5  # until a thousand connections are open, or closed
STOPPED = 5  # the exit code of a run that a signal stopped


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

    def end(self, turns):
        """The seconds that pages took that were asked for in one of the turns (begin, end). Of one
        that had not come at the end, the seconds so far, if they are more than one."""
        self.process.kill()
        self.process.wait()
        pages = []
        for line in self.log.read_text().splitlines():
            asked, *seconds = map(float, line.split())
            for begin, end in turns:
                if begin <= asked < end and seconds:
                    pages.append(seconds[0])
                elif begin <= asked < end - 1:
                    pages.append(end - asked)
        return pages


def server_seconds(process):
    """The time of a core that the server's threads have taken."""
    total = 0
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        if int(fields[16]) == SERVER_NICE:
            total += int((task / "schedstat").read_text().split()[0]) / 1e9
    return total


def progress(folder):
    """(step, seconds of training) at the last whole row of metrics.csv."""
    rows = (folder / "out" / "metrics.csv").read_text().rpartition("\n")[0].splitlines()
    row = dict(zip(rows[0].split(","), rows[-1].split(",")))
    return int(row["step"]), float(row["seconds"])


def take_turn(process, folder, seconds):
    """What a turn shows: its time, steps a second, and the server's share of a core."""
    time.sleep(SETTLING_SECONDS)
    begin, server = time.monotonic(), server_seconds(process)
    first_step, first_seconds = progress(folder)
    time.sleep(seconds)
    if process.poll() is not None:
        sys.exit("training ended too early:\n" + (folder / "log").read_text())
    step, training_seconds = progress(folder)
    end = time.monotonic()
    return {"time": (begin, end),
            "speed": (step - first_step) / (training_seconds - first_seconds),
            "server_share": (server_seconds(process) - server) / (end - begin)}


def run(arguments, folder, kind):
    """One run, in which `arguments.turns` turns with connections lie between turns without."""
    log = folder / "log"
    with log.open("w") as sink:
        process = subprocess.Popen(
            [os.path.abspath(arguments.program), "train", SCENE, "-o", folder / "out", "-r", "8",
             "--device", "cpu", "--iterations", "1000000", "--viewer", "--viewer-port", "0",
             "--set", "train.threads=1", "--set", "train.log_every=5"],
            stdout=sink, stderr=sink, preexec_fn=lambda: os.sched_setaffinity(0, TRAINING_CORE))
    port = port_of(log, process)
    probe_process = Probe(port, folder / "pages")
    time.sleep(SETTLING_SECONDS)
    without, under = [take_turn(process, folder, arguments.seconds)], []
    for turn in range(arguments.turns):
        attack = Attack(port, kind, arguments.connections)
        under.append(take_turn(process, folder, arguments.seconds))
        if turn == arguments.turns - 1:
            break
        attack.end()
        without.append(take_turn(process, folder, arguments.seconds))
    process.send_signal(signal.SIGTERM)
    begin = time.monotonic()
    code = process.wait(timeout=120)
    end_seconds = time.monotonic() - begin
    attack.end()
    if code != STOPPED:
        sys.exit(f"exit code {code}:\n" + log.read_text())
    return {"under": under, "without": without, "end_seconds": end_seconds,
            "pages": probe_process.end([turn["time"] for turn in under])}


def speeds(run_of_kind):
    """The speed of each turn with connections, of the mean of its neighbors without. The last one
    has one neighbor, and does not count."""
    under, without = run_of_kind["under"], run_of_kind["without"]
    return [one["speed"] / statistics.mean((before["speed"], after["speed"]))
            for one, before, after in zip(under, without, without[1:])]


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--kinds", nargs="*", help="parts of their names; none: all")
    arguments.add_argument("--connections", type=int, default=1000)
    arguments.add_argument("--turns", type=int, default=9, help="with connections, of each kind")
    arguments.add_argument("--seconds", type=float, default=4, help="of a turn")
    arguments.add_argument("--json", type=Path, help="write the figures here, too")
    arguments = arguments.parse_args()
    if len(CORES) < 2:
        sys.exit("this needs two cores")
    if arguments.turns < 3:
        sys.exit("a standard error needs three turns or more")
    kinds = [kind for kind in KINDS
             if not arguments.kinds or any(part in kind for part in arguments.kinds)]
    rows = []
    print("| connections | speed | server | page, median and worst | end |\n|---|---|---|---|---|")
    for kind in kinds:
        with tempfile.TemporaryDirectory() as folder:
            measured = run(arguments, Path(folder), kind)
        speed, pages = speeds(measured), measured["pages"] or [math.inf]
        row = {"kind": kind, "speed": statistics.mean(speed),
               "standard_error": statistics.stdev(speed) / math.sqrt(len(speed)),
               "server": statistics.mean(turn["server_share"] for turn in measured["under"]),
               "server_without": statistics.mean(turn["server_share"] for turn in measured["without"]),
               "page_median": statistics.median(pages), "page_worst": max(pages),
               "end": measured["end_seconds"], "run": measured}
        rows.append(row)
        print(f"| {kind} | {100 * row['speed']:.1f} ± {100 * row['standard_error']:.1f} % | "
              f"{100 * row['server']:.1f} % ({100 * row['server_without']:.1f} % without) | "
              f"{row['page_median']:.2f} s, {row['page_worst']:.2f} s | {row['end']:.1f} s |",
              flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--probe"]:
        probe(int(sys.argv[2]))
    main()
