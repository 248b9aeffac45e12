#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks C++ sources, and the headers of ours that they include, with clang-tidy 14 and .clang-tidy.
#   scripts/tidy.sh [FILE...]    these files, or every one that the build compiles; fails if anything is found
# It configures build/tidy, where each file would be compiled alone and no header before.
# CUDA files are left out: clang-tidy does not know all of nvcc's flags.
set -euo pipefail
called_from=$PWD
cd "$(dirname "$0")/.."
build=build/tidy
commands=$build/compile_commands.json

die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# Other versions have other checks. CLANG_TIDY names a program that is not on the PATH.
find_clang_tidy() {
  local name
  for name in "${CLANG_TIDY:-clang-tidy-14}" clang-tidy; do
    if "$name" --version 2>/dev/null | grep -q 'version 14\.'; then echo "$name"; return; fi
  done
  die "clang-tidy 14 was not found; install it (Debian: clang-tidy-14), or name it with CLANG_TIDY=FILE"
}

# The sources of the build that git knows, one a line, by their path from here. Generated ones are not looked at.
compiled_sources() {
  comm -12 <(sed -n 's|^ *"file": "\(.*\)",\{0,1\}$|\1|p' "$commands" | sed "s|^$PWD/||" | sort -u) \
           <(git ls-files '*.cpp' | sort)
}

# check_one TOOL BUILD FILE: prints what is found, and nothing where all is well.
check_one() {
  local findings
  # What clang-tidy says of itself ("12 warnings generated") goes to standard error.
  findings=$("$1" -p "$2" --quiet --header-filter="^$PWD/(apps|cuda|gs_[a-z]*|data_loaders|examples|tests)/" "$3" 2>/dev/null) &&
    [[ -z $findings ]] && return
  printf '%s: %s\n' "$3" "${findings:-clang-tidy failed; run $1 -p BUILD $3}"
  return 1
}
export -f check_one

tool=$(find_clang_tidy)
cmake --preset default -B "$build" -DGS_UNITY=OFF -DGS_PRECOMPILE_HEADERS=OFF --log-level=ERROR >/dev/null
mapfile -t known < <(compiled_sources)
if [[ $# -eq 0 ]]; then
  files=("${known[@]}")
else
  files=()
  for file; do
    path=$(realpath -m --relative-to=. "$called_from/$file")
    if [[ $file == /* ]]; then path=$(realpath -m --relative-to=. "$file"); fi
    [[ " ${known[*]} " == *" $path "* ]] ||
      die "$file is not compiled by $build; name a .cpp file of it (headers are checked with the files that include them)"
    files+=("$path")
  done
fi
printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 1 bash -c 'check_one "$@"' bash "$tool" "$build" ||
  die "the findings above are to be mended; for one that is right as it stands: // NOLINT(check-name): reason"
echo "clang-tidy: nothing found in ${#files[@]} files"
