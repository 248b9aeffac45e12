# SPDX-License-Identifier: Apache-2.0
"""Which calls the drop-ins drew, and which they passed on, and why."""

from __future__ import annotations

from collections import Counter

_calls: Counter = Counter()


def count(name, reason=None):
    """A call of the function of this name: drawn here, or passed to the installed package for a reason."""
    _calls[name, reason] += 1


def text():
    """A line for each function and reason."""
    lines = []
    for (name, reason), number in sorted(_calls.items(), key=str):
        fate = "by gemsplat" if reason is None else f"passed to the installed package: {reason}"
        lines.append(f"{name}: {number} {'call' if number == 1 else 'calls'} {fate}")
    return "\n".join(lines) or "no function of gemsplat.compat was called"
