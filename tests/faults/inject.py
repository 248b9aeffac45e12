#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes one call after the other fail in the program's verbs, and checks that each ends with one
plain error, goes on to the same bytes, and loses no file. See README.md beside this file."""

import random
import sys

import campaign
import scenarios

# The errors of each kind of call.
ERRORS = {
    "open": ("EMFILE", "EACCES", "EIO", "ENOSPC"),
    "read": ("EIO",),
    "write": ("ENOSPC", "EIO"),
    "rename": ("ENOSPC", "EACCES"),
    "folder": ("EACCES", "ENOSPC"),
    "sync": ("EIO", "ENOSPC"),
    "spawn": ("EAGAIN", "EMFILE"),
    "thread": ("EAGAIN",),
    "memory": ("ENOMEM",),
}


def chosen(kind, count, budget, draw):
    """Faults among `count` calls: all where they are few, else evenly spread and random ones."""
    if count <= budget:
        calls = list(range(1, count + 1))
    else:
        even = {1 + i * (count - 1) // max(1, budget // 2) for i in range(budget // 2)}
        calls = sorted(even | set(draw.sample(range(1, count + 1), budget - len(even))))
    for i, n in enumerate(calls):
        last = "+" if (i + n) % 3 == 0 else ""  # a full disk stays full
        yield f"{kind}:{n}{last}:{ERRORS[kind][(i + n // 2) % len(ERRORS[kind])]}"


def plan(counts, seconds, budget, draw):
    """Divides the budget among pairs of verb and kind. Kinds with few calls get them all, and verbs
    that take long get fewer."""
    pairs = sorted((count, verb, kind) for (verb, kind), count in counts.items() if count > 0)
    faults = []
    for i, (count, verb, kind) in enumerate(pairs):
        weights = [1 / seconds[v] for _, v, _ in pairs[i:]]
        share = max(1, round((budget - len(faults)) * weights[0] / sum(weights)))
        faults += [(verb, fault) for fault in chosen(kind, count, min(share, count), draw)]
    draw.shuffle(faults)
    return faults


def inject(slot, verb, fault):
    """One fault, what must hold after it, and going on."""
    reference = slot.prepare(verb)
    slot.reset(verb)
    outcome = slot.run(verb, fault)
    kind = fault.split(":")[0]
    result = campaign.Result(verb.name, kind, fault, outcome.code, [], errors=outcome.errors,
                             log=outcome.log)
    if "fired " not in outcome.log:
        # Threads take another order from run to run, and a visitor may have stopped the run.
        if outcome.code != 0 and not (verb.visit and outcome.code == 5):
            result.wrong = [f"no fault was injected, and yet exit code {outcome.code}"]
            result.wrong += campaign.faults_of_ending(outcome)
        return [result] if result.wrong else []
    result.wrong = campaign.faults_of_ending(outcome)
    result.wrong += campaign.lost_files(slot, verb, reference)
    loses_growth = campaign.LESS_GROWTH.search(outcome.errors) is not None
    if outcome.code == 0:
        result.survived = True
        if not loses_growth:
            different = list(campaign.differences(slot, verb, reference, outcome.errors, True))
            # Temporary files whose folder could not be listed are removed by the next call.
            if all("left over: tmp/" in what for what in different):
                different = different and campaign.go_on(slot, verb, reference, False)
            result.wrong += different
    elif outcome.code > 0:
        result.wrong += campaign.go_on(slot, verb, reference, loses_growth, outcome.errors)
    return [result]


def main():
    parser = campaign.options(__doc__)
    parser.add_argument("--faults", type=int, default=1200, help="in total")
    parser.add_argument("--kinds", help="only these, with commas between")
    parser.add_argument("--only", help="only this fault, such as write:37+:ENOSPC")
    arguments = parser.parse_args()
    verbs = campaign.verbs_of(arguments, list(scenarios.VERBS))
    kinds = arguments.kinds.split(",") if arguments.kinds else list(ERRORS)
    all_faults = campaign.Campaign(arguments, "faults")
    if arguments.only:
        faults = [(verb.name, arguments.only) for verb in verbs]
    else:
        slot = all_faults.free[-1]
        counts, seconds = {}, {}
        for verb in verbs:
            outcome = slot.prepare(verb).outcome
            counts.update({(verb.name, kind): outcome.counts.get(kind, 0) for kind in kinds})
            seconds[verb.name] = outcome.seconds
        faults = plan(counts, seconds, arguments.faults, random.Random(arguments.seed))
    tasks = [lambda slot, v=verb, f=fault: inject(slot, scenarios.VERBS[v], f)
             for verb, fault in faults]
    all_faults.work(tasks, len(tasks))
    return all_faults.end()


if __name__ == "__main__":
    sys.exit(main())
