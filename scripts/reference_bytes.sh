#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains short runs of a fixed seed, and writes one line for each: its name, the sha256 of its model and the count of
# its Gaussians. A change that leaves training as it is leaves these lines as they are: `diff` compares two outputs.
#   scripts/reference_bytes.sh [--program FILE] [--gpu] [--steps N] [--runs WORDS] ["SCENE [FLAG...]"...]
#     --program FILE  the program that trains [build/default/bin/gemsplat]
#     --gpu           on a GPU with --deterministic, also in batches of 2 and 4, and on two GPUs where there are two
#     --steps N       steps of each run [400]
#     --runs WORDS    only these of "defaults adaptive mcmc dynamic batch_2 batch_4 gpus_2" ["all that apply"]
#     SCENE           a folder with FLAGs of `gemsplat train`, in one argument; `dynamic` takes the numbers in the
#                     names of photos for their times unless the scene is one of Blender's [examples/courtyard]
# The bytes are those of one machine and one compiler: make both outputs on the same one.
set -euo pipefail
cd "$(dirname "$0")/.."

usage() { sed -n '5,11s/^# //p' "$0"; }

program=build/default/bin/gemsplat
steps=400
gpu=no
wanted=
scenes=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --program) program=${2:?--program needs a value}; shift 2 ;;
    --gpu) gpu=yes; shift ;;
    --steps) steps=${2:?--steps needs a value}; shift 2 ;;
    --runs) wanted=${2:?--runs needs a value}; shift 2 ;;
    -h | --help) usage; exit ;;
    -*) usage >&2; exit 2 ;;
    *) scenes+=("$1"); shift ;;
  esac
done
[[ ${#scenes[@]} -gt 0 ]] || scenes=(examples/courtyard)
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

device=(--device cpu)
runs=(defaults adaptive mcmc dynamic)
if [[ $gpu == yes ]]; then
  device=(--device cuda --deterministic)
  runs+=(batch_2 batch_4)
  [[ $(nvidia-smi -L | wc -l) -lt 2 ]] || runs+=(gpus_2)
fi
[[ -z $wanted ]] || read -ra runs <<<"$wanted"

# The flags of a run of that name in that scene, one a line.
flags_of() {
  case $1 in
    defaults) ;;
    adaptive | mcmc) printf '%s\n' -c "$1" ;;
    dynamic)
      printf '%s\n' -c dynamic
      compgen -G "$2/transforms*.json" >/dev/null || printf '%s\n' --set dataset.times=names
      ;;
    batch_*) printf '%s\n' --set "train.batch=${1#batch_}" ;;
    gpus_*) printf '%s\n' --gpus "${1#gpus_}" --set "train.batch=${1#gpus_}" ;;
    *) echo "error: there is no run $1" >&2; return 1 ;;
  esac
}

for words in "${scenes[@]}"; do
  read -ra scene <<<"$words"
  for run in "${runs[@]}"; do
    flags=$(flags_of "$run" "${scene[0]}")
    mapfile -t flags <<<"$flags"
    [[ -n ${flags[0]} ]] || flags=()
    name=$(basename "${scene[0]}")/$run
    "$program" train "${scene[@]}" -o "$out/$name" -q "${device[@]}" "${flags[@]}" --iterations "$steps" \
      --set train.seed=7 >"$out/log" 2>&1 || { tail -n 5 "$out/log" >&2; exit 1; }
    ply=$(find "$out/$name/point_cloud" -name point_cloud.ply)
    count=$(head -c 4096 "$ply" | sed -n 's/^element vertex //p;/^end_header/q')
    printf '%s %s %s\n' "$name" "$(sha256sum <"$ply" | cut -d' ' -f1)" "$count"
    rm -rf "${out:?}/$name"
  done
done
