#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws docs/lab/benchmarks/quality.csv as docs/images/quality.svg: quality over the seconds of
training. Needs nothing but Python 3.

    python3 scripts/plot_quality.py            # writes the picture
    python3 scripts/plot_quality.py --check    # changes nothing; fails if the picture is not that of the table

Rows of one scene and one trainer are the points of one curve, in the order of their seconds.
"""
import argparse
import csv
import math
import sys
from xml.sax.saxutils import escape

from plot_history import ROOT, line, number, text, ticks

TABLE = ROOT / "docs/lab/benchmarks/quality.csv"
PICTURE = ROOT / "docs/images/quality.svg"

METRICS = [("psnr", "PSNR of the test views / dB"), ("ssim", "SSIM of the test views")]
# A curve's color, light and dark; other trainers than gemsplat are dashed.
COLORS = {"defaults": ("#0969da", "#58a6ff"), "turbo": ("#1a7f37", "#3fb950"), "adaptive": ("#8250df", "#bc8cff"),
          "mcmc": ("#bf3989", "#ff7bd0"), "Faster-GS": ("#bc4c00", "#f0883e"), "gsplat": ("#7d4e00", "#d29922")}
OTHERS = {"Faster-GS", "gsplat"}

SECONDS = (1, 2, 5, 10, 20, 50, 100, 200)  # marks of the logarithmic axis

# Pixels.
WIDTH, MARGIN, TOP, LEGEND = 960, 16, 78, 56
AXIS, GAP, PLOT_HEIGHT, ROW_HEIGHT = 44, 10, 150, 216

STYLE = """
  text { font: 12px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; fill: var(--ink); }
  .title { font-size: 18px; font-weight: 600; } .row { font-size: 14px; font-weight: 600; }
  .faint { fill: var(--faint); font-size: 11px; } .grid { stroke: var(--grid); }
"""


def read_table():
    with open(TABLE, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, strict=True))
    for line, row in enumerate(rows, 2):
        if row["trainer"] not in COLORS:
            sys.exit(f"{TABLE}:{line}: trainer '{row['trainer']}' has no color in scripts/plot_quality.py")
        for name in ("seconds", "psnr"):
            if not float(row[name]) > 0:
                sys.exit(f"{TABLE}:{line}: {name} '{row[name]}' is not a number above 0")
    return rows


def style():
    name = lambda trainer: trainer.lower()
    rule = lambda theme: " ".join(f"--{name(t)}: {colors[theme]};" for t, colors in COLORS.items())
    lines = [STYLE,
             f"  svg {{ --ink: #1f2328; --faint: #656d76; --grid: #d8dee4; {rule(0)} }}",
             f"  @media (prefers-color-scheme: dark) {{ svg {{ --ink: #e6edf3; --faint: #8d96a0; --grid: #30363d; {rule(1)} }} }}"]
    for trainer in COLORS:
        dashes = " stroke-dasharray: 5 4;" if trainer in OTHERS else ""
        lines.append(f"  .{name(trainer)} {{ stroke: var(--{name(trainer)}); fill: none; stroke-width: 2;{dashes} }}")
        lines.append(f"  .{name(trainer)}dot {{ fill: var(--{name(trainer)}); }}")
    return "\n".join(lines)


def plot(rows, metric, left, top, width):
    """One scene and metric: seconds on a logarithmic axis."""
    points = [(float(row["seconds"]), float(row[metric]), row["trainer"]) for row in rows if row[metric]]
    seconds, values = [p[0] for p in points], [p[1] for p in points]
    x_low, x_high = math.log10(min(seconds)) - 0.08, math.log10(max(seconds)) + 0.08
    marks, digits = ticks(min(values), max(values))
    x_at = lambda second: left + AXIS + (math.log10(second) - x_low) / (x_high - x_low) * (width - AXIS)
    y_at = lambda value: top + PLOT_HEIGHT - (value - marks[0]) / (marks[-1] - marks[0]) * PLOT_HEIGHT
    out = []
    for mark in marks:
        out.append(line(left + AXIS, y_at(mark), left + width, y_at(mark), "grid"))
        out.append(text(left + AXIS - 5, y_at(mark) + 4, f"{mark:.{digits}f}", "faint", "end"))
    for second in SECONDS:
        if x_low <= math.log10(second) <= x_high:
            out.append(line(x_at(second), top, x_at(second), top + PLOT_HEIGHT, "grid"))
            out.append(text(x_at(second), top + PLOT_HEIGHT + 14, f"{second} s", "faint", "middle"))
    for trainer in COLORS:
        kind, curve = trainer.lower(), sorted(p[:2] for p in points if p[2] == trainer)
        places = [(number(x_at(second)), number(y_at(value))) for second, value in curve]
        if len(places) > 1:
            out.append(f'<polyline class="{kind}" points="{" ".join(f"{x},{y}" for x, y in places)}"/>')
        for x, y in places:
            radius = 5 if (x, y) == places[-1] else 3  # the end of a run
            out.append(f'<circle class="{kind}dot" cx="{x}" cy="{y}" r="{radius}"/>')
    return "\n".join(out)


def picture(rows):
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    width = (WIDTH - 2 * MARGIN - GAP * (len(scenes) - 1)) / len(scenes)
    height = TOP + ROW_HEIGHT * len(METRICS)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" role="img">',
           "<title>Quality over the seconds of training</title>", f"<style>{style()}\n</style>",
           text(MARGIN, 28, "Quality over the seconds of training, NVIDIA H200 and H100", "title")]
    x = MARGIN
    for trainer in dict.fromkeys(row["trainer"] for row in rows):
        out.append(line(x, LEGEND - 4, x + 24, LEGEND - 4, trainer.lower()))
        out.append(text(x + 30, LEGEND, trainer))
        x += 50 + 8 * len(trainer)
    for m, (metric, title) in enumerate(METRICS):
        top = TOP + m * ROW_HEIGHT
        for s, scene in enumerate(scenes):
            left = MARGIN + s * (width + GAP)
            out.append(f'<text x="{left + AXIS:.0f}" y="{top + 14}"><tspan class="row">{escape(scene)}</tspan>'
                       f'<tspan class="faint" dx="6">{escape(title if s == 0 else "")}</tspan></text>')
            out.append(plot([row for row in rows if row["scene"] == scene], metric, round(left), top + 26, round(width)))
    return "\n".join(out) + "\n</svg>\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; fail if the picture is not that of the table")
    arguments = parser.parse_args()
    drawn = picture(read_table())
    if not arguments.check:
        PICTURE.write_text(drawn, encoding="utf-8")
    elif not PICTURE.exists() or PICTURE.read_text(encoding="utf-8") != drawn:
        sys.exit(f"{PICTURE} is not the picture of {TABLE}; run scripts/plot_quality.py")


if __name__ == "__main__":
    main()
