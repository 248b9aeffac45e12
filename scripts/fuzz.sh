#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzz targets of tests/fuzz with clang++ and runs them, one on each core.
#   scripts/fuzz.sh [--seconds N] [TARGET...]     N seconds each (60); without names, all targets
#   scripts/fuzz.sh --runs N [TARGET...]          N inputs each, always the same ones; for CI
# What a target learns is kept in build/fuzz/corpus and used by the next run. A finding is kept in
# build/fuzz/findings, and is an error at the end.
set -euo pipefail
source "$(dirname "$0")/common.sh"

# One input: 5 s, 300 MB at once. A process may have twice that, since AddressSanitizer and the
# libraries take 150 to 250 MB before the first input.
readonly limits=(-timeout=5 -malloc_limit_mb=300 -rss_limit_mb=600)
readonly seeds=tests/fuzz/corpus learned=build/fuzz/corpus findings=build/fuzz/findings

is_number() { [[ ${2-} =~ ^[1-9][0-9]*$ ]] || die "$1 takes a whole number from 1 on"; }

length=(-max_total_time=60) words="60 s" targets=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --seconds) is_number "$@"; length=(-max_total_time="$2") words="$2 s"; shift 2 ;;
    --runs) is_number "$@"; length=(-runs="$2" -seed=1) words="$2 inputs"; shift 2 ;;
    -*) die "there is no flag $1; usage: scripts/fuzz.sh [--seconds N | --runs N] [TARGET...]" ;;
    *) targets+=("$1"); shift ;;
  esac
done
if [[ ${#targets[@]} -eq 0 ]]; then mapfile -t targets < <(ls $seeds); fi
for target in "${targets[@]}"; do
  [[ -d $seeds/$target ]] || die "there is no target $target; there are: $(ls -x -w 999 $seeds)"
done

# fuzz TARGET: one line with what it did; fails if it found something.
fuzz() {
  local target=$1 log=$learned/$1.log program=build/fuzz/tests/fuzz_$1 flags=("${limits[@]}") found=0
  mkdir -p "$learned/$target"
  [[ ! -f tests/fuzz/$target.dict ]] || flags+=("-dict=tests/fuzz/$target.dict")
  # FFmpeg decodes and holds some frames of the largest size that a video may have, 35 million pixels.
  [[ $target != videos ]] || flags+=(-rss_limit_mb=900 -timeout=15)
  # Standard input is no pipe: a config may name it as its base.
  "$program" "${flags[@]}" "${length[@]}" -max_len=16384 -print_final_stats=1 \
    -artifact_prefix="$findings/$target-" "$learned/$target" "$seeds/$target" \
    </dev/null >"$log" 2>&1 || found=1
  awk -v target="$target" '
    match($0, / cov: [0-9]+/) { edges = substr($0, RSTART + 6, RLENGTH - 6) }
    /^#[0-9]+/ { runs = substr($1, 2) }
    /^stat::number_of_executed_units/ { runs = $2 }
    /^stat::peak_rss_mb/ { memory = $2 }
    END { printf "%-14s %9d executions, %6d edges, %4d MB\n", target, runs, edges, memory }' "$log"
  [[ $found == 0 ]] || show_finding "$target" "$log"
  return $found
}

show_finding() {
  local target=$1 log=$2 input
  input=$(sed -n 's/.*Test unit written to //p' "$log" | tail -n 1)
  grep -m 3 -E 'ERROR|runtime error|terminate called|what\(\)' "$log" | sed 's/^/  /' || true
  printf '  the whole report: %s\n' "$log"
  printf '  repeat it with:   build/fuzz/tests/fuzz_%s %s %s\n' "$target" "${limits[*]}" "${input:-INPUT}"
}

install_clang
build fuzz fuzz_targets
mkdir -p $findings $learned
TMPDIR=$(mktemp -d "$([[ -w /dev/shm ]] && echo /dev/shm || echo /tmp)/gemsplat-fuzz.XXXXXX")
trap 'rm -rf "$TMPDIR"' EXIT
export TMPDIR
say "Fuzzing ${#targets[@]} targets, $words each, $(nproc) at a time"
found=0
for target in "${targets[@]}"; do
  if [[ $(jobs -rp | wc -l) -ge $(nproc) ]]; then wait -n || found=1; fi
  fuzz "$target" &
done
while [[ -n $(jobs -p) ]]; do wait -n || found=1; done
[[ $found == 0 ]] || die "a target found something; mend the reader, and add the input to $seeds/TARGET"
