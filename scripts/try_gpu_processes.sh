#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# On a machine with two GPUs or more: trains a scene with one GPU, with several in one process, and with one
# process each (docs/ranks.md), and says whether all models have the same bytes, and how long they took. Then it
# kills one of the processes. Ends with 1 where anything is not as it should be.
#   scripts/try_gpu_processes.sh [--gpus N] [--out DIR] [--timed] [SCENE [FLAG...]]
#     --gpus N    how many [2]
#     --out DIR   where to [out/gpu_processes]
#     --timed     also without --deterministic, which is slower
#     SCENE       [examples/courtyard]; FLAGs go to `gemsplat train` [--iterations 1500]
# GEMSPLAT names the program [build/minimal/bin/gemsplat], GEMSPLAT_NCCL the library if the system does not find it.
set -euo pipefail

usage() { sed -n '6,10s/^# //p' "$0"; }

gpus=2
out=out/gpu_processes
ways=(--deterministic)
while [[ $# -gt 0 ]]; do
  case $1 in
    --gpus) gpus=${2:?--gpus needs a value}; shift 2 ;;
    --out) out=${2:?--out needs a value}; shift 2 ;;
    --timed) ways+=(""); shift ;;
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
cd "$out"  # where the ranks that srun starts meet
verdict=0

# run NAME FLAG...: one run, its output into NAME.log.
run() {
  local name=$1
  shift
  "$program" train "$scene" -o "$out/$name" -q --set "train.batch=$gpus" "${flags[@]}" "$@" >"$name.log" 2>&1 || {
    echo "$name: failed"
    tail -n 5 "$name.log"
    verdict=1
  }
}

# As srun does: all processes start by themselves. Each sees all GPUs, and takes that of its number.
run_as_srun() {
  local name=$1 rank tasks=()
  for ((rank = 0; rank < gpus; ++rank)); do
    SLURM_PROCID=$rank SLURM_LOCALID=$rank SLURM_STEP_NUM_TASKS=$gpus SLURM_JOB_ID=$$ SLURM_STEP_ID=0 \
      "$program" train "$scene" -o "$out/$name" -q --device cuda --set "train.batch=$gpus" "${flags[@]}" "${@:2}" \
      >"$name.$rank.log" 2>&1 &
    tasks+=($!)
  done
  for rank in "${!tasks[@]}"; do
    wait "${tasks[$rank]}" || { echo "$name: rank $rank failed"; tail -n 5 "$name.$rank.log"; verdict=1; }
  done
}

# show NAME OTHER: time and hash of a run, which must be those of the other where that is named.
show() {
  local name=$1 ply hash seconds
  ply=$(find "$name" -name point_cloud.ply 2>/dev/null | sort -V | tail -n 1)
  [[ -n $ply ]] || { printf '%-28s no model\n' "$name"; verdict=1; return; }
  hash=$(sha256sum "$ply" | cut -c1-16)
  seconds=$(sed -n 's/.*"train_seconds": *\([0-9.]*\).*/\1/p' "$name/results.json" | head -n 1)
  if [[ -z $2 ]]; then
    printf '%-28s %8.2f s  %s\n' "$name" "$seconds" "$hash"
  elif cmp -s "$ply" "${ply/#$name/$2}"; then
    printf '%-28s %8.2f s  %s  same bytes\n' "$name" "$seconds" "$hash"
  else
    printf '%-28s %8.2f s  %s  OTHER BYTES\n' "$name" "$seconds" "$hash"
    verdict=1
  fi
}

for way in "${ways[@]}"; do
  tag=${way#--}
  tag=${tag:-timed}
  more=()
  [[ -z $way ]] || more=("$way")
  run "$tag-1" --device cuda "${more[@]}"
  run "$tag-$gpus-threads" --gpus "$gpus" "${more[@]}"
  run "$tag-$gpus-processes" --gpus "$gpus" --set train.rank_processes=true "${more[@]}"
  run_as_srun "$tag-$gpus-srun" "${more[@]}"
  other=
  [[ -z $way ]] || other=$tag-1
  show "$tag-1" ""
  for name in "$tag-$gpus-"{threads,processes,srun}; do show "$name" "$other"; done
done

# A process that is killed ends all of them, soon and with one message.
"$program" train "$scene" -o "$out/killed" -q --gpus "$gpus" --set train.rank_processes=true \
  --iterations 1000000 --checkpoint-every 200 >killed.log 2>&1 &
leader=$!
for ((i = 0; i < 600; ++i)); do
  [[ -z $(find killed/checkpoints -type f 2>/dev/null) ]] || break
  sleep 0.2
done
victim=$(grep -l "^PPid:[[:space:]]*$leader\$" /proc/[0-9]*/status 2>/dev/null | cut -d/ -f3 | tail -n 1 || true)
if [[ -z $victim ]]; then
  echo "killed: no other rank was found"
  tail -n 5 killed.log
  kill "$leader" || true
  verdict=1
else
  kill -9 "$victim"
  begin=$SECONDS
  code=0
  wait "$leader" || code=$?
  if grep -q 'ended by signal 9' killed.log && [[ $code -eq 3 && $((SECONDS - begin)) -lt 30 ]]; then
    echo "killed: the run has ended within $((SECONDS - begin)) s"
  else
    echo "killed: exit code $code after $((SECONDS - begin)) s"
    verdict=1
  fi
  grep 'error:' killed.log || true
fi
exit $verdict
