#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the fuzz targets of a bundle (scripts/fuzz_bundle.sh), each in a process of its own, on a
# machine without compiler and libraries.
#   run.sh SECONDS OUTPUT
# SECONDS of fuzzing and about one minute of tidying up later, OUTPUT has:
#   table.txt          executions, edges, memory and findings of each target
#   learned.tar.gz     what the targets have learned; put it beside run.sh, and the next call goes on
#   findings.tar.gz    inputs and logs of findings, if there are any
set -uo pipefail

[[ $# == 2 && $1 =~ ^[1-9][0-9]*$ ]] || { echo "usage: run.sh SECONDS OUTPUT" >&2; exit 2; }
readonly seconds=$1 bundle=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$2" || exit 2
output=$(cd "$2" && pwd)
readonly output most_restarts=20
readonly limits=(-timeout=5 -malloc_limit_mb=300 -rss_limit_mb=600)  # as in scripts/fuzz.sh
work=$(mktemp -d "$([[ -w /dev/shm ]] && echo /dev/shm || echo /tmp)/gemsplat-fuzz.XXXXXX") || exit 2
readonly work
trap 'rm -rf "$work"' EXIT
mkdir "$work"/{learned,kept,findings,logs,temp}
[[ ! -f $bundle/learned.tar.gz ]] || tar -xzf "$bundle/learned.tar.gz" -C "$work/learned"
mapfile -t targets < <(ls "$bundle/seeds")

# Random addresses of Linux 6 may lie where the AddressSanitizer of clang 14 has its own memory.
fixed_addresses=()
if setarch -R true 2>/dev/null; then fixed_addresses=(setarch -R); fi

# start TARGET FLAG...: one process of libFuzzer with the libraries of the bundle.
start() {
  local target=$1
  shift
  mkdir -p "$work/temp/$target"
  TMPDIR=$work/temp/$target LD_LIBRARY_PATH=$bundle/lib \
    "${fixed_addresses[@]}" "$bundle/bin/fuzz_$target" "${limits[@]}" -max_len=16384 "$@" </dev/null
}

# fuzz TARGET: goes on after findings, and after starts without a first input.
fuzz() {
  local target=$1 end=$((SECONDS + seconds)) restart log flags=()
  [[ ! -f $bundle/dictionaries/$target.dict ]] || flags=("-dict=$bundle/dictionaries/$target.dict")
  mkdir -p "$work/learned/$target"
  for ((restart = 0; restart < most_restarts && SECONDS < end; ++restart)); do
    log=$work/logs/$target.$restart.log
    start "$target" "${flags[@]}" -max_total_time=$((end - SECONDS)) -print_final_stats=1 \
      "-artifact_prefix=$work/findings/$target-" "$work/learned/$target" "$bundle/seeds/$target" \
      >"$log" 2>&1 && return
    grep -q '^#' "$log" && cp "$log" "$work/findings/$target.$restart.log"
  done
}

# keep TARGET: what it has learned, without what adds no edge.
keep() {
  local target=$1
  mkdir "$work/kept/$target"
  start "$target" -merge=1 -max_total_time=50 "-artifact_prefix=$work/temp/" \
    "$work/kept/$target" "$bundle/seeds/$target" "$work/learned/$target" \
    >"$work/logs/$target.merge" 2>&1
}

# summary TARGET: one line of the table.
summary() {
  local target=$1
  cat "$work/logs/$target".*.log | awk -v target="$target" '
    match($0, / cov: [0-9]+/) && substr($0, RSTART + 6) + 0 > edges { edges = substr($0, RSTART + 6, RLENGTH - 6) + 0 }
    /^#[0-9]+/ { part = substr($1, 2) + 0 }
    /^stat::number_of_executed_units/ { runs += $2; part = 0 }
    /^stat::peak_rss_mb/ && $2 + 0 > memory { memory = $2 + 0 }
    END { printf "%-14s %10d executions, %6d edges, %4d MB", target, runs + part, edges, memory }'
  printf ', %d findings\n' "$(find "$work/findings" -name "$target-*" | wc -l)"
}

for target in "${targets[@]}"; do fuzz "$target" & done
wait
for target in "${targets[@]}"; do keep "$target" & done
wait
{
  printf '%s s of each target, %s cores, %s\n' "$seconds" "$(nproc)" "$(date -u +%Y-%m-%dT%H:%MZ)"
  for target in "${targets[@]}"; do summary "$target"; done
} | tee "$output/table.txt"
tar -czf "$output/learned.tar.gz" -C "$work/kept" .
rm -f "$output/findings.tar.gz"
if [[ -n $(ls "$work/findings") ]]; then
  tar -czf "$output/findings.tar.gz" -C "$work/findings" .
  exit 1
fi
