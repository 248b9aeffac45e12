#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws docs/lab/benchmarks/history.csv as docs/images/benchmark_history.svg. Needs Python 3 alone.

    python3 scripts/plot_history.py            # writes the picture
    python3 scripts/plot_history.py --check    # changes nothing; fails if a row is wrong or the picture is not that of the table

Each row of the table is one figure of one commit, measured on one scene. Add rows below the others of gemsplat, by
the date of the commit that was measured (UTC), and draw the picture anew.
"""
import argparse
import csv
import datetime
import math
import pathlib
import re
import sys
from xml.sax.saxutils import escape

ROOT = pathlib.Path(__file__).resolve().parent.parent
TABLE = ROOT / "docs/lab/benchmarks/history.csv"
PICTURE = ROOT / "docs/images/benchmark_history.svg"

COLUMNS = ["date", "trainer", "commit", "device", "scene", "resolution", "steps", "gaussians", "quantity", "value", "runs", "source"]
QUANTITIES = ["train_seconds", "step_ms", "frame_ms", "test_psnr_db", "test_ssim", "gpu_memory_gib"]
OURS, OTHER, DEVICE = "gemsplat", "Faster-GS", "NVIDIA H200"

# The rows of charts: title, unit, whether the axis begins at zero, and each chart's name with the columns that select its rows.
TRAINED = {"steps": "30000"}
SOUTH = {"scene": "south_building", "steps": ""}
CHARTS = [
    ("Training time, 30,000 steps", "s", True, "train_seconds", [
        ("fox_640", {"scene": "fox_640", "resolution": "359x640", **TRAINED}),
        ("fox_1080", {"scene": "fox_1080", "resolution": "605x1080", **TRAINED}),
        ("south_building", {"scene": "south_building", "resolution": "1200x897", **TRAINED})]),
    ("Rendering time of a frame, south_building", "ms", True, "frame_ms", [
        ("1200x897", {"resolution": "1200x897", **SOUTH}),
        ("2400x1794", {"resolution": "2400x1794", **SOUTH}),
        ("3600x2691", {"resolution": "3600x2691", **SOUTH})]),
    ("PSNR of the test views after 30,000 steps", "dB", False, "test_psnr_db", [
        ("fox_640", {"scene": "fox_640", "resolution": "359x640", **TRAINED}),
        ("fox_1080", {"scene": "fox_1080", "resolution": "605x1080", **TRAINED}),
        ("south_building", {"scene": "south_building", "resolution": "1200x897", **TRAINED})]),
]

# Pixels.
WIDTH, MARGIN, TOP = 960, 20, 64
CHART_WIDTH, CHART_GAP, PLOT_HEIGHT = 296, 16, 110
ROW_HEIGHT = 230  # title, chart's name, plot, two lines of labels
AXIS = 44         # for the numbers left of a plot
MOST_LABELS = 4   # of commits below a plot

STYLE = """
  text { font: 12px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; fill: var(--ink);
         paint-order: stroke; stroke: var(--ground); stroke-width: 4px; stroke-linejoin: round; }
  .title { font-size: 18px; font-weight: 600; } .row { font-size: 14px; font-weight: 600; } .value { font-weight: 600; }
  .faint { fill: var(--faint); font-size: 11px; } .mono { font-family: ui-monospace, Menlo, Consolas, monospace; }
  .grid { stroke: var(--grid); } .ours { fill: none; stroke: var(--ours); stroke-width: 2; } .dot { fill: var(--ours); }
  .other { stroke: var(--other); stroke-width: 2; stroke-dasharray: 6 4; } .othertext { fill: var(--other); }
  svg { --ground: #ffffff; --ink: #1f2328; --faint: #656d76; --grid: #d8dee4; --ours: #0969da; --other: #bc4c00; }
  @media (prefers-color-scheme: dark) {
    svg { --ground: #0d1117; --ink: #e6edf3; --faint: #8d96a0; --grid: #30363d; --ours: #58a6ff; --other: #f0883e; }
  }
"""


class TableError(Exception):
    """A row that cannot be right; the message names its line."""


def check_row(row, line):
    def refuse(what):
        raise TableError(f"line {line}: {what}")

    if None in row or None in row.values():
        refuse(f"it has another number of fields than the {len(COLUMNS)} columns")
    for name in ("trainer", "device", "scene", "source"):
        if not row[name]:
            refuse(f"{name} is empty")
    if row["trainer"] == OURS:
        try:
            datetime.datetime.strptime(row["date"], "%Y-%m-%dT%H:%M")
        except ValueError:
            refuse(f"date '{row['date']}' is not of the form 2026-11-22T09:53")
        if not re.fullmatch("[0-9a-f]{7,40}", row["commit"]):
            refuse(f"commit '{row['commit']}' is not an abbreviated hash")
    if row["quantity"] not in QUANTITIES:
        refuse(f"quantity '{row['quantity']}' is none of {', '.join(QUANTITIES)}")
    if not re.fullmatch("[0-9]+x[0-9]+", row["resolution"]):
        refuse(f"resolution '{row['resolution']}' is not of the form 1200x897")
    for name in ("steps", "gaussians", "runs"):
        if not re.fullmatch("[1-9][0-9]*|", row[name]):
            refuse(f"{name} '{row[name]}' is neither empty nor a whole number above 0")
    if not re.fullmatch(r"[0-9]+(\.[0-9]+)?", row["value"]) or float(row["value"]) <= 0:
        refuse(f"value '{row['value']}' is not a number above 0")


def read_table(path):
    """The rows as dictionaries; throws TableError for what is wrong, repeated or out of order."""
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file, strict=True)
        if reader.fieldnames != COLUMNS:
            raise TableError(f"line 1: the columns are not {','.join(COLUMNS)}")
        rows, seen, latest = [], {}, ""
        for row in reader:
            check_row(row, reader.line_num)
            key = tuple(row[name] for name in COLUMNS[1:7] + ["quantity"])
            if key in seen:
                raise TableError(f"line {reader.line_num}: the same figure as in line {seen[key]}")
            seen[key] = reader.line_num
            if row["trainer"] == OURS and row["date"] < latest:
                raise TableError(f"line {reader.line_num}: older than the row above; rows of gemsplat go by date")
            if row["trainer"] == OURS:
                latest = row["date"]
            rows.append(row)
    return rows


def select(rows, trainer, quantity, wanted):
    wanted = {"trainer": trainer, "device": DEVICE, "quantity": quantity, **wanted}
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def ticks(low, high):
    """At most six round numbers that span low to high, and how many digits they have after the point."""
    power = math.floor(math.log10((high - low) / 5))
    for factor, digits in ((1, 0), (2, 0), (2.5, 1), (5, 0), (10, 0)):
        step = factor * 10.0 ** power
        first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
        if last - first <= 5:
            break
    return [i * step for i in range(first, last + 1)], max(0, digits - power)


def number(value):
    return f"{value:.1f}".rstrip("0").rstrip(".")


def text(x, y, content, kind="", anchor="start"):
    return f'<text x="{number(x)}" y="{number(y)}" class="{kind}" text-anchor="{anchor}">{escape(content)}</text>'


def line(x1, y1, x2, y2, kind):
    return f'<line x1="{number(x1)}" y1="{number(y1)}" x2="{number(x2)}" y2="{number(y2)}" class="{kind}"/>'


def commit_labels(ours, places, y):
    """Hash and day below some of the commits: the last one, and those before it at even distances."""
    every = math.ceil(len(ours) / MOST_LABELS)
    shapes = []
    for i in range(len(ours) - 1, -1, -every):
        day = datetime.datetime.strptime(ours[i]["date"], "%Y-%m-%dT%H:%M")
        shapes.append(text(places[i], y + 16, ours[i]["commit"][:7], "faint mono", "middle"))
        shapes.append(text(places[i], y + 30, f"{day:%b} {day.day}", "faint", "middle"))
    return shapes


def axis(values, from_zero):
    low, high = min(values), max(values)
    if from_zero:
        return ticks(0, high)
    room = max(0.25, 0.15 * (high - low))
    return ticks(low - room, high + room)


def chart(x, y, name, unit, from_zero, ours, other):
    """One plot with its name: our figures commit by commit, and the other trainer's as a dashed line."""
    marks, digits = axis([float(row["value"]) for row in ours + other], from_zero)
    left, right, top, bottom = x + AXIS, x + CHART_WIDTH - 24, y + 24, y + 24 + PLOT_HEIGHT

    def height(value):
        return bottom - (value - marks[0]) / (marks[-1] - marks[0]) * PLOT_HEIGHT

    shapes = [text(x, y, name, "mono")]
    for mark in marks:
        shapes.append(line(left - 6, height(mark), right + 12, height(mark), "grid"))
        shapes.append(text(left - 12, height(mark) + 4, f"{mark:.{digits}f}", "faint", "end"))
    for row in other:
        level = height(float(row["value"]))
        shapes.append(line(left - 6, level, right + 12, level, "other"))
        below = height(float(ours[0]["value"])) < level  # on the side where our line does not begin
        shapes.append(text(left, level + (16 if below else -6), f"{row['value']} {unit}", "othertext"))
    inset = 16  # so that the first and the last label stay within the plot
    step = (right - left - 2 * inset) / max(1, len(ours) - 1)
    places = [left + inset + step * i for i in range(len(ours))]
    levels = [height(float(row["value"])) for row in ours]
    points = " ".join(f"{number(px)},{number(py)}" for px, py in zip(places, levels))
    shapes.append(f'<polyline points="{points}" class="ours"/>')
    for row, px, py in zip(ours, places, levels):
        tip = f"{row['commit']}, {row['date'][:10]}: {row['value']} {unit}"
        shapes.append(f'<circle cx="{number(px)}" cy="{number(py)}" r="3.5" class="dot"><title>{escape(tip)}</title></circle>')
    above = levels[-1] - 9 if levels[-1] - top > 16 else levels[-1] + 18
    shapes.append(text(places[-1] + 10, above, f"{ours[-1]['value']} {unit}", "value", "end"))
    return shapes + commit_labels(ours, places, bottom)


def legend():
    y = 52
    return [line(MARGIN, y - 4, MARGIN + 28, y - 4, "ours"), text(MARGIN + 36, y, "gemsplat, commit by commit"),
            line(MARGIN + 230, y - 4, MARGIN + 258, y - 4, "other"), text(MARGIN + 266, y, f"{OTHER}, as handed to us"),
            text(WIDTH - MARGIN, y, "docs/lab/benchmarks/history.csv", "faint", "end")]


def draw(rows):
    """The whole picture as SVG; charts without figures of ours are left out."""
    shapes = [text(MARGIN, 30, "gemsplat on one NVIDIA H200", "title"), *legend()]
    y = TOP
    for title, unit, from_zero, quantity, charts in CHARTS:
        shapes.append(text(MARGIN, y + 26, f"{title} ({unit})", "row"))
        for i, (name, wanted) in enumerate(charts):
            ours, other = (select(rows, trainer, quantity, wanted) for trainer in (OURS, OTHER))
            if ours:
                shapes += chart(MARGIN + i * (CHART_WIDTH + CHART_GAP), y + 50, name, unit, from_zero, ours, other)
        y += ROW_HEIGHT
    height = y + 8
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" role="img">',
        "<title>History of gemsplat's benchmarks</title>",
        f"<style>{STYLE}</style>",
        f'<rect width="{WIDTH}" height="{height}" rx="8" style="fill: var(--ground)"/>',
        *shapes, "</svg>", ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="change nothing; fail if the table is wrong or the picture old")
    parser.add_argument("--table", type=pathlib.Path, default=TABLE)
    parser.add_argument("--picture", type=pathlib.Path, default=PICTURE)
    arguments = parser.parse_args()
    try:
        picture = draw(read_table(arguments.table))
    except (TableError, csv.Error, UnicodeDecodeError) as error:
        sys.exit(f"error: {arguments.table}, {error}")
    if not arguments.check:
        arguments.picture.write_text(picture, encoding="utf-8")
    elif not arguments.picture.exists() or arguments.picture.read_text(encoding="utf-8") != picture:
        sys.exit(f"error: {arguments.picture} is not drawn from {arguments.table}; run python3 scripts/plot_history.py")


if __name__ == "__main__":
    main()
