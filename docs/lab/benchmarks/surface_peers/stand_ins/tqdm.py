# SPDX-License-Identifier: Apache-2.0
"""A progress bar that keeps the times of the training loop for runner.py."""
import sys
import time

TIMES = []  # (step, seconds since the loop began)


class tqdm:
    def __init__(self, iterable=None, desc="", total=None, **_):
        self.items, self.desc, self.n, self.start = iterable, desc, 0, time.time()
        self.is_training = desc.startswith("Training")
        if self.is_training:
            TIMES.append((0, 0.0))
        self.note = {}

    def __iter__(self):
        return iter(self.items)

    def set_postfix(self, values=None, **more):
        self.note = {**(values or {}), **more}

    def set_description(self, text="", **_):
        self.desc = text

    def update(self, count=1):
        self.n += count
        if self.is_training and self.n % 1000 == 0:
            TIMES.append((self.n, time.time() - self.start))
            print(f"step {self.n}: {TIMES[-1][1]:.1f} s, {self.note}", flush=True)

    def close(self):
        if self.is_training:
            TIMES.append((self.n, time.time() - self.start))

    @staticmethod
    def write(text):
        print(text, flush=True)


def trange(*numbers, **how):
    return tqdm(range(*numbers), **how)


sys.modules[__name__ + ".auto"] = sys.modules[__name__]  # for `from tqdm.auto import tqdm`
