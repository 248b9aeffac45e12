#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains the bundled scene: on the GPU where there is one, else a short run on the CPU (minutes on 2 cores).
#   scripts/demo.sh           trains into out/demo; goes on with a run that was interrupted; a finished
#                             one is only shown
#   scripts/demo.sh --again   trains afresh into the next free folder: out/demo-2, ...
set -euo pipefail
source "$(dirname "$0")/common.sh"

scene=examples/courtyard
program=build/default/bin/gemsplat

is_finished() { [[ -s $1/results.json ]]; }

# The run folders, oldest first.
runs() { find out -maxdepth 1 -type d \( -name demo -o -name 'demo-[0-9]*' \) 2>/dev/null | sort -V; }

next_free_run() {
  local run=out/demo number=1
  while [[ -e $run ]]; do
    number=$((number + 1))
    run=out/demo-$number
  done
  echo "$run"
}

# "test" comes first in results.json, so its PSNR is the first one there.
test_psnr() { grep -o '"psnr": *[0-9.]*' "$1/results.json" | sed -n '1s/.*: *//p'; }

show() {
  local run=$1 file
  say "Test PSNR: $(LC_ALL=C printf '%.2f' "$(test_psnr "$run")") dB, the mean over photos that were held out"
  say "A render of 20 dB is blurred; one of 30 dB is hard to tell from its photo"
  for file in "$run/results.json" "$run/comparison.png" "$run"/point_cloud/*/point_cloud.ply; do
    if [[ -e $file ]]; then echo "   $file"; fi
  done
  say "Look at it in the browser: $program view $run"
}

again=no
case ${1:-} in
  '') ;;
  --again) again=yes ;;
  *) sed -n '3,6s/^# //p' "$0"; exit 2 ;;
esac

run=$(next_free_run)
if [[ $again == no ]]; then
  for folder in $(runs); do
    if is_finished "$folder"; then finished=$folder; else run=$folder; fi
  done
  if [[ -n ${finished:-} ]]; then
    say "$finished holds a finished run; ./scripts/demo.sh --again trains afresh, beside it"
    show "$finished"
    exit
  fi
fi

install_packages
if ! nvidia-smi -L >/dev/null 2>&1 && [[ ! -e build/default/CMakeCache.txt ]]; then
  say "There is no GPU, so no CUDA is compiled, which saves minutes; for CUDA call first: cmake --preset cuda -B build/default"
  gs_configure_args+=(-DGS_WITH_CUDA=OFF)
fi
build default gemsplat

schedule=(-c configs/cpu_tiny.toml)
if nvidia-smi -L >/dev/null 2>&1 && grep -q '^GS_BUILT_WITH_CUDA:INTERNAL=TRUE' build/default/CMakeCache.txt; then
  schedule=()
fi
say "Training $scene into $run"
"$program" train "$scene" -o "$run" --eval --resume auto "${schedule[@]}"
show "$run"
if [[ -d build/default/python ]] && ! compgen -G 'build/default/python/gemsplat/_gemsplat*.so' >/dev/null; then
  say "The Python module is not built yet; ./scripts/setup.sh builds it (some minutes)"
fi
