#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Counts what the libraries of the method consist of: settings, lines, and instances of kernels. One line for each.
#   scripts/count_core.sh [LIBRARY]
#     LIBRARY   libgs_cuda.a of a build [the newest one in build/*/cuda]; without one, kernels are not counted
set -euo pipefail
cd "$(dirname "$0")/.."

[[ ${1:-} != -* ]] || { sed -n '4,5s/^# //p' "$0"; exit 2; }
library=${1:-$(find build -path 'build/*/cuda/libgs_cuda.a' -printf '%T@ %p\n' 2>/dev/null | sort -rn | sed -n '1s/^[^ ]* //p')}
fields=gs_core/config/config_fields.h
# The libraries of the method, and what has moved out of them.
folders=(gs_core gs_render gs_train cuda gs_eval gs_model/lod
  'gs_model/edit/decimate.*' 'gs_model/edit/merge_gaussians.*' 'gs_model/edit/polygon.*' 'gs_model/edit/select.*'
  'gs_model/edit/upright.*')

show() { printf '%7d  %s\n' "$1" "$2"; }

lines_of() { git ls-files -- "$@" | grep -E '\.(h|cpp|cuh|cu|in)$' | tr '\n' '\0' | xargs -0 cat | wc -l; }

# Names of the library's kernels, one line for each instance: the host function that launches one keeps a static
# variable, by whose guard the instance is known.
kernels() { nm "$library" 2>/dev/null | sed -n 's/^.* [bBuV] _ZGVZ.*__device_stub__\(.*\)E5__tmp$/\1/p'; }

show "$(grep -c '^  field("' $fields)" settings
show "$(grep -c '^  field("density\.' $fields)" "of these in [density]"
for folder in "${folders[@]}"; do show "$(lines_of "$folder")" "lines in $folder"; done
show "$(lines_of "${folders[@]}")" "lines in all of these"
if [[ -n $library ]]; then
  names=$(kernels)
  own=$(grep '^ZN2gs' <<<"$names" || true)
  show "$(grep -cE 'preprocess_backward|update_by_photos|[0-9]+adam_' <<<"$own")" \
    "kernels of stages 7 and 8 in $library"
  show "$(grep -c . <<<"$own")" "kernels of this project"
  show "$(grep -c . <<<"$names")" "kernels with those of CUB"
fi
