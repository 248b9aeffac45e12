#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# On a GPU server: builds the preset `minimal`, runs all tests and benchmarks of the GPU, trains the scenes given,
# and writes all results to DIR/gpu_check.json. A part that fails does not stop the others; it is named at the end.
#   scripts/gpu_check.sh [--out DIR] [--runs N] [--iterations N] [SCENE...]
#     --out DIR        where to [out/gpu_check]
#     --runs N         train each scene so often, with seeds 1 to N [3]
#     --iterations N   training steps [as the defaults have it]
# Needs nvcc, g++, CMake, ninja or make, python3, and the headers of scripts/pack_headers.sh in .deps. Where there is no git,
# GS_COMMIT may name the commit.
set -euo pipefail

usage() { sed -n '5,8s/^# //p' "$0"; }

out=out/gpu_check
runs=3
train_flags=()
scenes=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --out | --runs | --iterations)
      [[ $# -gt 1 ]] || { echo "error: $1 needs a value" >&2; usage >&2; exit 2; }
      case $1 in
        --out) out=$2 ;;
        --runs) runs=$2 ;;
        --iterations) train_flags=(--iterations "$2") ;;
      esac
      shift 2 ;;
    -h | --help) usage; exit ;;
    -*) echo "error: there is no flag $1" >&2; usage >&2; exit 2 ;;
    *) scenes+=("$(realpath -m "$1")"); shift ;;
  esac
done
[[ $runs =~ ^[1-9][0-9]*$ ]] || { echo "error: --runs takes a whole number from 1 on, not $runs" >&2; exit 2; }
out=$(realpath -m "$out")
source "$(dirname "$0")/common.sh"

program=build/minimal/bin/gemsplat
failed=()

# part NAME COMMAND...: runs a command, its output into DIR/NAME.log; remembers whether it failed.
part() {
  local name=$1 begin=$SECONDS verdict=passed
  shift
  say "$name"
  "$@" >"$out/$name.log" 2>&1 || verdict=failed
  printf '%s\t%s\t%d\n' "$name" "$verdict" $((SECONDS - begin)) >>"$out/parts.tsv"
  [[ $verdict == failed ]] || return 0
  failed+=("$name")
  tail -n 5 "$out/$name.log"
}

build_all() {
  local generator=()
  command -v ninja >/dev/null || generator=(-G "Unix Makefiles")
  cmake --preset minimal "${generator[@]}" -DGS_WITH_CUDA=ON -DGS_REQUIRE_CUDA=ON -DGS_BUILD_TESTS=ON &&
    cmake --build build/minimal -j "$(nproc)"
}

run_tests() {
  ctest --test-dir build/minimal -L cuda -j 4 --output-on-failure --no-tests=error --output-junit "$out/tests.xml"
}

run_selftest() { "$program" selftest --device cuda --json >"$out/selftest.json"; }

# compute-sanitizer lies on the PATH, or where nvcc does.
find_sanitizer() {
  command -v compute-sanitizer || ls "$(dirname "$(realpath "$(command -v nvcc)")")/compute-sanitizer" 2>/dev/null
}

# sanitize TOOL: small scenes, and models with odd numbers, under that tool of compute-sanitizer.
sanitize() {
  local check=("$sanitizer" --tool "$1" --error-exitcode 9)
  part "$1-render" "${check[@]}" build/minimal/tests/cuda_tests --gtest_filter='CudaEdge.*-*65536*'
  part "$1-blend" "${check[@]}" build/minimal/tests/cuda_tests --gtest_filter='*TwoOpaque*:*AtItsCenter'
  part "$1-step" "${check[@]}" build/minimal/tests/cuda_tests --gtest_filter='CudaStep.*FusedStep*:CudaStep.*ModelsOfAnyNumbers*:CudaStep.Few*'
  part "$1-photometric" "${check[@]}" build/minimal/tests/cuda_tests --gtest_filter='CudaPhotometric.AStepIs*:CudaPhotometric.ABatchIs*'
}

# bench NAME ARGUMENT...: what to time; figures into DIR/bench-NAME.json.
bench() {
  local name=$1
  shift
  part "bench-$name" "$program" bench "$@" --device cuda -o "$out/bench-$name.json"
}

# Trains a scene with each seed, into DIR/SCENE-SEED, and times the last model.
train() {
  local scene=$1 name seed
  name=$(basename "$scene")
  for ((seed = 1; seed <= runs; ++seed)); do
    part "train-$name-$seed" "$program" train "$scene" -o "$out/$name-$seed" --force --eval --seed "$seed" \
      --device cuda "${train_flags[@]}"
  done
  bench "$name" "$out/$name-$runs" --scales 1,2,3
}

# All results in one file, from those of the parts. Arguments: DIR RUNS COMMIT GPU SCENE...
write_results() {
  python3 - "$@" <<'EOF_PYTHON'
import json, os, statistics, sys
import xml.etree.ElementTree as xml

out, runs, commit, gpu, *scenes = sys.argv[1:]

def read(name):
    try:
        with open(os.path.join(out, name)) as file:
            return json.load(file)
    except (OSError, ValueError):
        return None

def tests():
    try:
        suite = xml.parse(os.path.join(out, "tests.xml")).getroot()
    except (OSError, xml.ParseError):
        return None
    count, failed, skipped = (int(suite.get(key, 0)) for key in ("tests", "failures", "skipped"))
    return {"passed": count - failed - skipped, "failed": failed, "skipped": skipped}

def run_of(scene, seed):
    results = read(f"{scene}-{seed}/results.json") if passed.get(f"train-{scene}-{seed}") else None
    if results is None:
        return {"seed": seed, "failed": True}
    run = {key: results.get(key) for key in ("seed", "train_seconds", "num_gaussians", "peak_gpu_bytes")}
    test = results.get("test") or {}
    return run | {"psnr": test.get("psnr"), "ssim": test.get("ssim")}

def medians(scene_runs):
    result = {}
    for key in ("train_seconds", "psnr", "ssim", "num_gaussians", "peak_gpu_bytes"):
        values = [run[key] for run in scene_runs if run.get(key) is not None]
        result[key] = statistics.median(values) if values else None
    return result

with open(os.path.join(out, "parts.tsv")) as file:
    parts = [line.rstrip("\n").split("\t") for line in file]
passed = {name: verdict == "passed" for name, verdict, _ in parts}

results = {"commit": commit, "gpu": gpu, "passed": all(passed.values()),
           "parts": {name: {"passed": verdict == "passed", "seconds": int(seconds)}
                     for name, verdict, seconds in parts},
           "tests": tests(),
           "sanitizers": {name: "clean" if ok else "errors" for name, ok in passed.items()
                          if name.startswith(("memcheck", "racecheck"))} or "not found",
           "selftest": read("selftest.json"),
           "bench": {name: read(f"bench-{name}.json") for name in ("200k", "1M")},
           "scenes": {}}
for scene in map(os.path.basename, scenes):
    scene_runs = [run_of(scene, seed) for seed in range(1, int(runs) + 1)]
    results["scenes"][scene] = {"runs": scene_runs, "median": medians(scene_runs),
                                "bench": read(f"bench-{scene}.json")}
with open(os.path.join(out, "gpu_check.json"), "w") as file:
    json.dump(results, file, indent=2)
    file.write("\n")
EOF_PYTHON
}

twice=$(printf '%s\n' "${scenes[@]##*/}" | sort | uniq -d)
[[ -z $twice ]] || die "two scenes have the name $twice; check them one after the other, with another --out"
command -v python3 >/dev/null || die "python3 was not found; install it and run this again"
command -v nvcc >/dev/null || die "nvcc was not found; put it on the PATH (often /usr/local/cuda/bin) and run this again"
mkdir -p "$out"
rm -f "$out"/{parts.tsv,tests.xml,gpu_check.json,selftest.json} "$out"/bench-*.json "$out"/*.log

part build build_all
if [[ ${#failed[@]} -eq 0 ]]; then
  part tests run_tests
  part selftest run_selftest
  if sanitizer=$(find_sanitizer); then
    sanitize memcheck
    sanitize racecheck
  else
    say "compute-sanitizer was not found: left out"
  fi
  bench 200k --gaussians 200000 --width 640 --height 360
  bench 1M --gaussians 1000000 --width 1600 --height 1064
  for scene in "${scenes[@]}"; do train "$scene"; done
fi

commit=${GS_COMMIT:-$(git describe --always --dirty 2>/dev/null || echo unknown)}
gpu=$(nvidia-smi --query-gpu=name,driver_version --format=csv,noheader 2>/dev/null | head -n 1 || true)
write_results "$out" "$runs" "$commit" "$gpu" "${scenes[@]}"
say "Results: $out/gpu_check.json"
[[ ${#failed[@]} -eq 0 ]] || die "failed: ${failed[*]}; their output is in $out/NAME.log"
say "All parts passed"
