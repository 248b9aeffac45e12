#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Formats C++ and CUDA sources with clang-format 14 and .clang-format, as an editor does that formats when it saves.
# Tables whose columns are aligned by hand stand between `// clang-format off` and `// clang-format on`.
#   scripts/format.sh [FILE...]           formats these files, or every tracked one
#   scripts/format.sh --check [FILE...]   changes nothing, shows what would change, fails if anything would
set -euo pipefail

die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# Other versions format some lines in another way. CLANG_FORMAT names a program that is not on the PATH.
find_clang_format() {
  local name
  for name in "${CLANG_FORMAT:-clang-format-14}" clang-format; do
    if "$name" --version 2>/dev/null | grep -q 'version 14\.'; then echo "$name"; return; fi
  done
  die "clang-format 14 was not found; install it (Debian: clang-format-14), or name it with CLANG_FORMAT=FILE"
}

check=no
if [[ ${1:-} == --check ]]; then check=yes; shift; fi
if [[ $# -gt 0 ]]; then
  files=("$@")
else
  cd "$(dirname "$0")/.."
  mapfile -t files < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh')
fi
tool=$(find_clang_format)

if [[ $check == no ]]; then
  printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 32 "$tool" -i
  exit
fi

# Fast, and says nothing where all is well.
if printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 32 "$tool" --dry-run --Werror 2>/dev/null; then exit; fi

# show_changes TOOL FILE...: a diff for each file that is not formatted.
show_changes() {
  local tool=$1 file changes formatted=yes
  shift
  for file; do
    changes=$("$tool" "$file" | diff -u --label "$file" --label "$file, formatted" "$file" -) && continue
    printf '%s\n' "$changes"
    formatted=no
  done
  [[ $formatted == yes ]]
}
export -f show_changes
printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 32 bash -c 'show_changes "$@"' bash "$tool" ||
  die "the files above are not formatted; run scripts/format.sh"
