# SPDX-License-Identifier: Apache-2.0
"""What the campaigns share: a folder for each worker, one run of the program in it, and the rules
that hold after every failure."""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import scenarios
from visitor import Visitor

HANGS_AFTER = 60  # seconds
EXIT_CODES = (0, 2, 3, 4, 5)  # docs/reference/conventions.md; 1 would be a bug of the program
# Text that belongs to a debugger, and not to a user.
RAW_TEXT = re.compile(r"std::|bad_alloc|terminate called|json\.exception|basic_string|what\(\)|"
                      r"filesystem error|_M_|internal error|Sanitizer|\[json|vector::")
# The words of warnings about files that are missing or left over.
TELLS_A_LOSS = re.compile(r"could not be written|was not written|is missing or incomplete|"
                          r"no checkpoint of step|older checkpoints may stay|"
                          r"cannot be removed now|is still on record|"
                          r"is encoded as MPEG-4 Part 2")
# Memory that runs out in training costs growth, and the program says so: the model then differs.
LESS_GROWTH = re.compile(r"and the model stays at \d+ Gaussians|is skipped for lack of memory")


@dataclass
class Outcome:
    """How one process ended."""

    code: int  # negative: a signal
    errors: str = ""
    seconds: float = 0
    hung: bool = False
    log: str = ""  # of the library
    counts: dict = field(default_factory=dict)


class Slot:
    """The folder of one worker. Its path is the same for all runs in it, since files hold paths."""

    def __init__(self, folder, program, library):
        self.folder, self.program, self.library = folder, program, library
        self.case = folder / "case"
        self.prepared = {}

    # ---- processes -------------------------------------------------------------------------------

    def start(self, verb, variables=None, more=(), stops=False):
        """Starts the command, and a visitor where the verb has one, who may stop the run."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith("GS_FAULT")}
        environment.update(TMPDIR=str(self.case / "tmp"), XDG_CACHE_HOME=str(self.case / "cache"),
                           OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", LC_ALL="C.UTF-8")
        # Leaks are for check_more.sh sanitizers: LeakSanitizer itself fails where a thread ends meanwhile.
        environment["ASAN_OPTIONS"] = "detect_leaks=0"
        environment.update(variables or {})
        outputs = [self.folder / "stdout.txt", self.folder / "stderr.txt"]
        self.errors = open(outputs[1], "w+b")
        with open(outputs[0], "wb") as said:
            process = subprocess.Popen([str(self.program), *verb.arguments, *more], cwd=self.case,
                                       env=environment, stdin=subprocess.DEVNULL, stdout=said,
                                       stderr=self.errors, start_new_session=True)
        self.visitor = None
        if verb.visit:
            self.visitor = Visitor(process, outputs, verb.visit, stops)
            self.visitor.start()
        return process

    def wait(self, process, begin):
        hung = False
        try:
            process.wait(HANGS_AFTER)
        except subprocess.TimeoutExpired:
            hung = True
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if self.visitor:
            self.visitor.join()
        self.errors.seek(0)
        text = self.errors.read().decode(errors="replace")
        self.errors.close()
        return Outcome(process.returncode, text, time.monotonic() - begin, hung)

    def run(self, verb, fault=None, counted=False, more=()):
        """The command of a verb, with or without a fault. Of the runs that a visitor controls and
        that meet a fault, every other one is stopped."""
        variables = {}
        log = self.folder / "faults.log"
        log.unlink(missing_ok=True)
        if fault or counted:
            variables = {"LD_PRELOAD": str(self.library), "GS_FAULT_ROOT": str(self.case),
                         "GS_FAULT_LOG": str(log), "GS_FAULT": fault or "",
                         "GS_FAULT_DEPTH": str(int(verb.faults_in_children)),
                         "ASAN_OPTIONS": "verify_asan_link_order=0:detect_leaks=0"}
        begin = time.monotonic()
        stops = fault is not None and zlib.crc32(fault.encode()) % 2 == 1
        outcome = self.wait(self.start(verb, variables, more, stops), begin)
        if verb.faults_in_children:
            for file in sorted(self.case.rglob("train.log")):
                outcome.errors += file.read_text(errors="replace")
        if log.exists():
            outcome.log = log.read_text(errors="replace")
        for line in outcome.log.splitlines():
            if line.startswith("counts "):  # of several children, the most
                for word in line.split()[1:]:
                    kind, count = word.split("=")
                    outcome.counts[kind] = max(outcome.counts.get(kind, 0), int(count))
        return outcome

    # ---- the folder ------------------------------------------------------------------------------

    def reset(self, verb):
        """The folder as it is before the command."""
        shutil.rmtree(self.case, ignore_errors=True)
        shutil.copytree(self.folder / verb.name, self.case, symlinks=True)

    def prepare(self, verb):
        """Makes the folder before the command, runs the command undisturbed, and keeps what is
        there then: all later runs are compared with it."""
        if verb.name in self.prepared:
            return self.prepared[verb.name]
        shutil.rmtree(self.case, ignore_errors=True)
        scenarios.write_inputs(verb, self.case)
        self.make_run(verb)
        for arguments in verb.before:
            made = self.run(scenarios.Verb("before", arguments))
            if made.code != 0:
                raise SystemExit(f"{' '.join(arguments)} fails without a fault:\n{made.errors}")
        scenarios.write_user_files(verb, self.case)
        shutil.copytree(self.case, self.folder / verb.name)
        before, folders = self.hashes(), self.folders()
        outcome = self.run(verb, counted=True)
        if outcome.code != 0:
            raise SystemExit(f"{verb.name} fails without a fault:\n{outcome.errors}")
        self.prepared[verb.name] = Reference(before, folders, self.contents(), outcome)
        return self.prepared[verb.name]

    def make_run(self, verb):
        train = scenarios.VERBS["train"]
        if "run" in verb.needs and self.run(train).code != 0:
            raise SystemExit("a run for the other verbs cannot be trained")
        if "cut" in verb.needs:
            killed = self.run(train, fault="sync:25:KILL")
            if killed.code != -signal.SIGKILL or not list(self.case.glob("run/checkpoints/*.ckpt")):
                raise SystemExit("no run was cut off after a checkpoint; choose another N")

    def hashes(self):
        return {name: scenarios.digest(data) for name, data in self.bytes_of_files()}

    def folders(self):
        return {str(p.relative_to(self.case)) for p in self.case.rglob("*") if p.is_dir()}

    def contents(self):
        return {name: scenarios.digest(scenarios.comparable(name, data))
                for name, data in self.bytes_of_files() if not name.startswith("cache/")}

    def bytes_of_files(self):
        """All files with their bytes. A child of a killed process dies a moment after it, and may
        remove the file of its lock meanwhile."""
        for name, path in scenarios.files_below(self.case).items():
            try:
                yield name, path.read_bytes()
            except FileNotFoundError:
                pass


@dataclass
class Reference:
    """What a verb's undisturbed command found and left."""

    before: dict
    folders: set
    after: dict
    outcome: Outcome


# ---- the rules -----------------------------------------------------------------------------------


def faults_of_ending(outcome):
    """What is wrong with how a process ended."""
    if outcome.hung:
        return [f"it hung for {HANGS_AFTER} s"]
    if outcome.code < 0:
        return [f"it was ended by signal {-outcome.code}"]
    wrong = []
    if outcome.code not in EXIT_CODES:
        wrong.append(f"exit code {outcome.code}")
    if outcome.code in (2, 3, 4) and not re.search(r"^error: .{10,}", outcome.errors, re.M):
        wrong.append(f"exit code {outcome.code} without an error")
    if raw := RAW_TEXT.search(outcome.errors):
        wrong.append(f"raw text in a message: {raw.group()}")
    return wrong


def lost_files(slot, verb, reference):
    """Files that were there before and are neither in place nor kept under another name. Of a run
    that was cut off, only the user's own files count: the rest is ours to go on with."""
    now = slot.hashes()
    kept = set(now.values())
    for name, content in reference.before.items():
        is_ours = "cut" in verb.needs and name.startswith("run/") and name not in verb.user_files
        if not is_ours and now.get(name) != content and content not in kept:
            yield f"lost: {name}"


def is_backup_or_lock(name):
    """Older files that were kept, and lock files that a kill has left, which lock nothing."""
    return re.search(r"\.bak-\d+|(^|/)\.[^/]+\.lock$", name) is not None


def differences(slot, verb, reference, errors, may_lack, is_going_on=False):
    """How the files differ from those of the undisturbed command. With `may_lack`, a file may be
    missing, or an older one left over, if a warning says so. After going on, an older checkpoint may
    stay beside the newest one, and the model of a run that was stopped."""
    def counts(name):
        return not is_backup_or_lock(name) and not re.match(verb.varies, name)

    all_now = slot.contents()
    now = {name: c for name, c in all_now.items() if counts(name)}
    aside = {c for name, c in all_now.items() if is_backup_or_lock(name)}
    wanted = {name: c for name, c in reference.after.items() if counts(name)}
    told = "\n".join(line for line in errors.splitlines() if TELLS_A_LOSS.search(line))
    for name, content in wanted.items():
        if now.get(name) == content:
            continue
        # A run that saved a model and no checkpoint is moved aside with what the user put there.
        if is_going_on and name in verb.user_files and content in aside:
            continue
        is_ours_to_lack = may_lack and verb.may_lack and name.startswith(verb.may_lack)
        base = Path(name).name
        is_told = base in told or scenarios.SIGNS.get(base, base) in told
        if not (is_ours_to_lack and is_told):
            yield f"{'differs' if name in now else 'is missing'}: {name}"
    for name in now.keys() - wanted.keys():
        is_older = name.endswith(".ckpt") and (
            is_going_on or may_lack and re.search("no checkpoint of|older check", told))
        # A run that lost its experiment stops, and saves what it has.
        is_older = is_older or is_going_on and re.search(r"point_cloud/iteration_\d+/", name)
        is_named = any(p.startswith(".gemsplat-") and p in told for p in Path(name).parts)
        if not (is_older or may_lack and is_named):
            yield f"is left over: {name}"


def go_on(slot, verb, reference, loses_growth, first_errors=""):
    """Runs the same command undisturbed, and says what is wrong then. What the first one said it
    could not write may be missing. Where nothing has changed, that run is the reference itself."""
    if slot.hashes() == reference.before and slot.folders() == reference.folders:
        return []
    again = slot.run(verb, more=verb.again)
    wrong = [f"going on: {text}" for text in faults_of_ending(again)]
    if again.code != 0:
        return wrong + [f"going on: exit code {again.code}: {again.errors[-600:]}"]
    wrong += lost_files(slot, verb, reference)
    if not loses_growth:
        told = TELLS_A_LOSS.search(first_errors) is not None
        found = differences(slot, verb, reference, first_errors, told, is_going_on=True)
        wrong += [f"going on: {d}" for d in found]
    return wrong


# ---- what both programs have in common -----------------------------------------------------------


@dataclass
class Result:
    """One failure, and what is wrong after it; nothing if all rules hold."""

    verb: str
    kind: str
    what: str
    code: int
    wrong: list
    survived: bool = False
    errors: str = ""
    log: str = ""


def options(description):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--program", type=Path, required=True, help="the program gemsplat")
    parser.add_argument("--library", type=Path, required=True, help="libfail_nth.so")
    parser.add_argument("--verbs", help="only these, with commas between")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("-j", "--jobs", type=int, default=os.cpu_count(), help="at a time")
    parser.add_argument("--json", type=Path, help="write all results to this file")
    parser.add_argument("--work", type=Path, help="a folder to work in, which is kept")
    return parser


class Campaign:
    """Runs tasks in slots, one folder for each worker, and collects their results."""

    def __init__(self, arguments, name):
        self.arguments, self.name = arguments, name
        self.begin = time.monotonic()
        self.results, self.lock = [], threading.Lock()
        self.folder = arguments.work or Path(tempfile.mkdtemp(prefix="gemsplat-faults-"))
        self.free = []
        for i in range(arguments.jobs):
            slot_folder = self.folder.resolve() / f"slot{i}"
            shutil.rmtree(slot_folder, ignore_errors=True)
            slot_folder.mkdir(parents=True)
            self.free.append(Slot(slot_folder, arguments.program.resolve(),
                                  arguments.library.resolve()))

    def is_over(self):
        return time.monotonic() - self.begin > self.arguments.seconds

    def in_slot(self, task):
        with self.lock:
            slot = self.free.pop()
        try:
            return task(slot)
        finally:
            with self.lock:
                self.free.append(slot)

    def work(self, tasks, total):
        """Each task takes a slot and returns results. `total` is how many are expected."""
        def work_off(task):
            if self.is_over():
                return
            for result in self.in_slot(task):
                with self.lock:
                    self.results.append(result)
                    self.show(result, total)

        with ThreadPoolExecutor(self.arguments.jobs) as pool:
            for done in [pool.submit(work_off, task) for task in tasks]:
                done.result()

    def show(self, result, total):
        failed = sum(bool(r.wrong) for r in self.results)
        if result.wrong:
            print(f"\n{result.verb}, {result.what}: " + "; ".join(result.wrong[:6]), flush=True)
            print("  repeat: " + self.repeats(result), flush=True)
            for line in (result.errors.strip().splitlines() or ["(nothing)"])[-3:]:
                print("  | " + line[:300], flush=True)
        if len(self.results) % 50 == 0 or len(self.results) == total:
            print(f"{len(self.results)}/{total} {self.name}, {failed} of them wrong, "
                  f"{time.monotonic() - self.begin:.0f} s", flush=True)

    def repeats(self, result):
        return (f"{sys.argv[0]} --program {self.arguments.program} --library "
                f"{self.arguments.library} --verbs '{result.verb}' --only {result.what}")

    def table(self):
        """Markdown: a row for each kind, a column for each verb."""
        verbs = [v for v in scenarios.VERBS if any(r.verb == v for r in self.results)]
        kinds = sorted({r.kind for r in self.results})
        lines = ["| | " + " | ".join(f"`{v}`" for v in verbs) + " | all |",
                 "|---" * (len(verbs) + 2) + "|"]
        for kind in kinds + ["all"]:
            row = [r for r in self.results if kind in (r.kind, "all")]
            cells = [sum(r.verb == v for r in row) for v in verbs] + [len(row)]
            lines.append(f"| {kind} | " + " | ".join(map(str, cells)) + " |")
        return "\n".join(lines)

    def end(self, **more):
        """Prints and writes the results. Returns the exit code of the script."""
        wrong = [r for r in self.results if r.wrong]
        print(self.table())
        print(f"{len(self.results)} {self.name}: {len(wrong)} wrong, "
              f"{sum(r.survived for r in self.results)} survived with exit code 0, "
              f"{time.monotonic() - self.begin:.0f} s", flush=True)
        if self.arguments.json:
            report = {"program": str(self.arguments.program), "seed": self.arguments.seed, **more,
                      "results": [vars(r) for r in self.results]}
            self.arguments.json.write_text(json.dumps(report, indent=1) + "\n")
        if not self.arguments.work:
            shutil.rmtree(self.folder, ignore_errors=True)
        return 1 if wrong or not self.results else 0


def verbs_of(arguments, default):
    names = arguments.verbs.split(",") if arguments.verbs else default
    for name in names:
        if name not in scenarios.VERBS:
            raise SystemExit(f"there is no verb {name}; there are {', '.join(scenarios.VERBS)}")
    return [scenarios.VERBS[name] for name in names]
