# SPDX-License-Identifier: Apache-2.0
"""Runs a script of a peer with our stand-ins for missing packages, and notes time and memory.

    runner.py PEER FOLDER_OF_PEERS REPORT.json SCRIPT [ARGUMENTS]
"""
import json
import os
import runpy
import sys
import time

peer, root, report, script = sys.argv[1:5]
tools = os.path.dirname(os.path.abspath(__file__))
start = time.time()
sys.path[:0] = [f"{root}/{peer}", f"{tools}/stand_ins", f"{root}/site/{peer}", f"{root}/site/both"]
sys.modules["torch.utils.tensorboard"] = None  # the peers then write no event files
os.environ.setdefault("MPLBACKEND", "Agg")
for name in [n for n in sys.modules if n.split(".")[0] == "tqdm"]:
    del sys.modules[name]
import torch  # noqa: E402
import tqdm  # noqa: E402

sys.argv = [script] + sys.argv[5:]
said = {"peer": peer, "script": os.path.basename(script), "imports_s": time.time() - start}
try:
    runpy.run_path(script, run_name="__main__")
    said["status"] = "ok"
except SystemExit as end:
    said["status"] = "ok" if not end.code else f"exit {end.code}"
except BaseException as error:
    said["status"] = f"{type(error).__name__}: {error}"[:300]
    raise
finally:
    said["total_s"] = time.time() - start
    said["steps"] = tqdm.TIMES
    said["loop_s"] = tqdm.TIMES[-1][1] if tqdm.TIMES else None
    if torch.cuda.is_available():
        said["peak_allocated_gib"] = torch.cuda.max_memory_allocated() / 2**30
        said["peak_reserved_gib"] = torch.cuda.max_memory_reserved() / 2**30
    with open(report, "w") as file:
        json.dump(said, file, indent=1)
