#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Kills the program by SIGKILL, at random moments and in place of chosen calls, until the same
command has ended well, and checks that it ends in the bytes of a run that was never killed. See
README.md beside this file."""

import os
import random
import signal
import sys
import time
from pathlib import Path

import campaign
import scenarios

VERBS = ("train", "export", "reconstruct", "experiment", "edit", "merge", "partition", "georef",
         "tiles", "mesh", "undistort", "view", "control")  # fmt: skip
CALLS = ("open", "write", "rename", "sync", "folder", "spawn")  # a kill in place of one
MOST_KILLS = 4  # of one run, before it may end


def children_of(process):
    """The processes below one; those that are gone by now are left out."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            parents.setdefault(int(fields[1]), []).append(int(folder.name))
        except OSError:
            continue
    found, todo = [], [process]
    while todo:
        todo += (below := parents.get(todo.pop(), []))
        found += below
    return found


def kill_at_a_moment(slot, verb, seconds, draw, of_child):
    """Starts the command, and kills it or one of its children after a random time."""
    begin = time.monotonic()
    process = slot.start(verb, stops=draw.random() < 0.5)
    time.sleep(draw.random() * seconds)
    targets = [process.pid]
    if of_child:  # it waits for one
        while not (targets := children_of(process.pid)) and process.poll() is None:
            time.sleep(0.002)
    if process.poll() is None:
        try:
            os.kill(draw.choice(targets), signal.SIGKILL)
        except ProcessLookupError:  # the child has ended meanwhile
            pass
    return slot.wait(process, begin)


def kills_of_one_run(slot, verb, kills, seed):
    """Kills a run up to `kills` times, then lets it end."""
    draw = random.Random(seed)
    reference = slot.prepare(verb)
    slot.reset(verb)
    results = []
    counts = reference.outcome.counts
    for i in range(kills):
        way = draw.choice(["moment", "call"] + ["child"] * bool(counts.get("spawn")))
        if way == "call":
            kind = draw.choice([k for k in CALLS if counts.get(k)])
            fault = f"{kind}:{draw.randint(1, counts[kind])}:KILL"
            outcome = slot.run(verb, fault)
        else:
            fault = way
            outcome = kill_at_a_moment(slot, verb, reference.outcome.seconds, draw, way == "child")
        result = campaign.Result(verb.name, way, f"{seed}:{fault}", outcome.code, [],
                                 errors=outcome.errors, log=outcome.log)
        if outcome.code != -signal.SIGKILL:
            result.wrong = campaign.faults_of_ending(outcome)
        result.wrong += campaign.lost_files(slot, verb, reference)
        is_killed = outcome.code == -signal.SIGKILL or (way == "child" and outcome.code != 0)
        if is_killed or result.wrong:
            results.append(result)
        if outcome.code == 0:
            break  # it was over before
    if results:
        results[-1].wrong += campaign.go_on(slot, verb, reference, False)
    return results


class Kills:
    """Deals out runs until there were enough kills."""

    def __init__(self, arguments):
        self.arguments = arguments
        self.all = campaign.Campaign(arguments, "kills")

    def tasks(self, verbs):
        wanted = {verb.name: self.arguments.kills // len(verbs) for verb in verbs}
        for run in range(self.arguments.kills * 4):
            verb = verbs[run % len(verbs)]
            seed = self.arguments.seed * 1_000_000 + run
            yield lambda slot, v=verb, s=seed: self.one(slot, v, s, wanted[v.name])

    def one(self, slot, verb, seed, wanted):
        done = sum(r.verb == verb.name for r in self.all.results)
        if done >= wanted:
            return []
        kills = min(wanted - done, 1 + seed % MOST_KILLS)
        return kills_of_one_run(slot, verb, kills, seed)


def main():
    parser = campaign.options(__doc__)
    parser.add_argument("--kills", type=int, default=500, help="in total")
    parser.add_argument("--only", help="only the run with this seed, which is the first number of "
                        "what a failure prints; its length is that of the campaign")
    arguments = parser.parse_args()
    verbs = campaign.verbs_of(arguments, VERBS)
    kills = Kills(arguments)
    if arguments.only:
        seed = int(arguments.only.split(":")[0])
        kills.all.work([lambda slot, v=v: kills_of_one_run(slot, v, 1 + seed % MOST_KILLS, seed)
                        for v in verbs], 1)
    else:
        kills.all.work(list(kills.tasks(verbs)), arguments.kills)
    return kills.all.end()


if __name__ == "__main__":
    sys.exit(main())
