#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the changelog of a Debian package from CHANGELOG.md.

    changelog.py --package NAME --release 1~bookworm --version V --maintainer "NAME <ADDRESS>" CHANGELOG.md OUT

Each version of CHANGELOG.md is one entry of the day that its heading names. What stands under
Unreleased belongs to V: then the entry of V is that of the commit (SOURCE_DATE_EPOCH), and names
the distribution UNRELEASED. OUT is compressed, and has the same bytes for the same texts and time.
"""
import argparse
import datetime
import email.utils
import gzip
import os
import re
import sys
import textwrap
from pathlib import Path

WIDTH = 80  # what Debian's tools take for a line


def sections(text):
    """Pairs of a heading of the second level, such as "[0.1.0] - 2026-11-22", and the lines below it."""
    parts = re.split(r"^## (.+)$", text, flags=re.M)
    return [(head.strip(), body.strip("\n").split("\n")) for head, body in zip(parts[1::2], parts[2::2])]


def plain(text):
    """Markdown's links become their texts, and bold words plain ones."""
    return re.sub(r"\*\*(.+?)\*\*", r"\1", re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", text))


def paragraphs(lines):
    """Headings, items and free text, each as one line: pairs of a mark (#, - or nothing) and a text."""
    found = []
    for line in lines:
        mark = re.match(r"(###|-) ", line)
        if mark:
            found.append([mark.group(1)[0], line[mark.end():].strip()])
        elif line.strip() and found and found[-1][1] and found[-1][0] != "#":
            found[-1][1] += " " + line.strip()
        else:
            found.append(["", line.strip()])
    return [(mark, plain(text)) for mark, text in found if text]


def items(lines):
    """The text of an entry: items begin with an asterisk, headings stand in brackets."""
    written = []
    for mark, text in paragraphs(lines):
        if mark == "#":
            written += ["", f"  [ {text} ]"]
        else:
            written += textwrap.wrap(text, WIDTH, initial_indent="  * ", subsequent_indent="    ",
                                     break_long_words=False, break_on_hyphens=False)
    return "\n".join(written).strip("\n")


def entries(text, version, now):
    """Tuples of version, lines, moment, and whether it is released; the newest first."""
    unreleased, found = [], []
    for head, lines in sections(text):
        named = re.fullmatch(r"\[([0-9][^\]]*)\] - (\d{4})-(\d\d)-(\d\d)", head)
        if named:
            day = datetime.datetime(*map(int, named.group(2, 3, 4)), tzinfo=datetime.timezone.utc)
            found.append((named.group(1), lines, day, True))
        elif head == "[Unreleased]":
            unreleased = lines
        else:
            sys.exit(f"error: the heading '## {head}' of the changelog is neither [Unreleased] nor '[VERSION] - YYYY-MM-DD'")
    older = [entry for entry in found if entry[0] != version]
    own = [entry for entry in found if entry[0] == version]
    if items(unreleased):
        return [(version, unreleased + [""] + (own[0][1] if own else []), now, False)] + older
    if not own:
        sys.exit(f"error: the changelog says nothing of version {version}")
    return own + older


def changelog(text, arguments, now):
    written = []
    for version, lines, moment, released in entries(text, arguments.version, now):
        distribution = (arguments.release.partition("~")[2] or "unstable") if released else "UNRELEASED"
        written.append(f"{arguments.package} ({version}-{arguments.release}) {distribution}; urgency=medium\n\n"
                       f"{items(lines)}\n\n -- {arguments.maintainer}  {email.utils.format_datetime(moment)}\n")
    return "\n".join(written)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("--package", "--version", "--release", "--maintainer"):
        parser.add_argument(name, required=True)
    parser.add_argument("changelog", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH") or datetime.datetime.now().timestamp())
    now = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc)
    text = changelog(arguments.changelog.read_text(encoding="utf-8"), arguments, now)
    arguments.out.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main()
