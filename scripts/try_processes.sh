#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# On a machine with two GPUs: trains a scene with one GPU, with two in one process, and with two processes that
# talk to each other as those of two machines do (docs/method/several_gpus.md#processes), and says
# whether all models have the same bytes, and how long they took. Then it kills one of two processes
# at a random moment, again and again: the other must end within 30 s with one message, and the run
# must go on with one process. Ends with 1 where anything is not as it should be.
#   scripts/try_processes.sh [--kills N] [--out DIR] [--direct] [SCENE [FLAG...]]
#     --kills N   how often [10]
#     --out DIR   where to [out/processes]
#     --direct    the GPUs may use NVLink and shared memory: for times; nobody is killed
#     SCENE       [examples/courtyard]; FLAGs go to `gemsplat train` [--iterations 1500]
# GEMSPLAT names the program [build/minimal/bin/gemsplat], GEMSPLAT_NCCL the library if the system does not find it.
set -euo pipefail

usage() { sed -n '8,12s/^# //p' "$0"; }

kills=10
out=out/processes
export NCCL_P2P_DISABLE=1 NCCL_SHM_DISABLE=1
while [[ $# -gt 0 ]]; do
  case $1 in
    --kills) kills=${2:?--kills needs a value}; shift 2 ;;
    --out) out=${2:?--out needs a value}; shift 2 ;;
    --direct) unset NCCL_P2P_DISABLE NCCL_SHM_DISABLE; kills=0; shift ;;
    -h | --help) usage; exit ;;
    *) break ;;
  esac
done
scene=$(realpath -m "${1:-$(dirname "$0")/../examples/courtyard}")
flags=("${@:2}")
[[ ${#flags[@]} -gt 0 ]] || flags=(--iterations 1500)
out=$(realpath -m "$out")
program=$(realpath -m "${GEMSPLAT:-$(dirname "$0")/../build/minimal/bin/gemsplat}")
[[ -x $program ]] || { echo "error: there is no program $program; build it, or name it with GEMSPLAT" >&2; exit 2; }
rm -rf "$out"
mkdir -p "$out"
cd "$out"
verdict=0
step=0

fail() {
  echo "$1"
  verdict=1
}

# start NAME FLAG...: two processes as srun starts them, each a step of its own, their logs in NAME.0.log and
# NAME.1.log. Sets `tasks`.
start() {
  local name=$1 rank
  shift
  tasks=()
  step=$((step + 1))
  for rank in 0 1; do
    SLURM_PROCID=$rank SLURM_LOCALID=$rank SLURM_STEP_NUM_TASKS=2 SLURM_JOB_ID=$$ SLURM_STEP_ID=$step \
      "$program" train "$scene" -o "$out/$name" -q --device cuda --set train.batch=2 "$@" >"$name.$rank.log" 2>&1 &
    tasks+=($!)
  done
}

# show NAME: time and hash of a run, whose model must be that of the run `one`.
show() {
  local name=$1 ply hash seconds word=
  ply=$(find "$name" -name point_cloud.ply 2>/dev/null | sort -V | tail -n 1)
  [[ -n $ply ]] || { fail "$name: no model"; return; }
  hash=$(sha256sum "$ply" | cut -c1-16)
  seconds=$(sed -n 's/.*"train_seconds": *\([0-9.]*\).*/\1/p' "$name/results.json" | head -n 1)
  cmp -s "$ply" "${ply/#$name/one}" || { word=" OTHER BYTES"; verdict=1; }
  printf '%-14s %8.2f s  %s%s\n' "$name" "$seconds" "$hash" "$word"
}

"$program" train "$scene" -o one -q --device cuda --deterministic --set train.batch=2 "${flags[@]}" >one.log 2>&1 ||
  fail "one: $(tail -n 3 one.log)"
"$program" train "$scene" -o gpus -q --gpus 2 --deterministic "${flags[@]}" >gpus.log 2>&1 ||
  fail "gpus: $(tail -n 3 gpus.log)"
start processes --deterministic "${flags[@]}"
for rank in 0 1; do
  wait "${tasks[$rank]}" || fail "process $rank: $(tail -n 3 "processes.$rank.log")"
done
for name in one gpus processes; do show "$name"; done

for ((k = 0; k < kills; ++k)); do
  rm -rf killed
  start killed --iterations 1000000 --checkpoint-every 200
  moment=$((RANDOM % 12)).$((RANDOM % 10))
  sleep "$moment"
  victim=$((RANDOM % 2))
  other=$((1 - victim))
  kill -9 "${tasks[$victim]}" || fail "process $victim had ended: $(tail -n 3 "killed.$victim.log")"
  begin=$SECONDS
  (sleep 60; kill -9 "${tasks[$other]}" 2>/dev/null) &
  guard=$!
  code=0
  wait "${tasks[$other]}" || code=$?
  took=$((SECONDS - begin))
  kill "$guard" 2>/dev/null || true
  messages=$(grep -c 'error:' "killed.$other.log" || true)
  [[ $code -eq 3 && $took -le 30 && $messages -eq 1 ]] ||
    fail "kill $k of process $victim after $moment s: exit code $code after $took s, $messages messages"
  # It goes on with one process until it is asked to stop.
  "$program" train "$scene" -o killed --resume auto --device cuda --set train.batch=2 --iterations 1000000 \
    --checkpoint-every 200 >resumed.log 2>&1 &
  resumed=$!
  sleep 8
  kill -INT "$resumed" 2>/dev/null || true
  code=0
  wait "$resumed" || code=$?
  [[ $code -eq 5 ]] || fail "kill $k: the run did not go on (exit code $code): $(tail -n 3 resumed.log)"
  echo "kill $k of process $victim after $moment s: the other ended after $took s; $(grep -o 'goes on after step [0-9]*' resumed.log || echo 'started anew')"
  grep 'error:' "killed.$other.log" | head -n 1 || true
done
exit $verdict
