#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Formats C++ and CUDA sources with clang-format 14 and .clang-format, and the JavaScript of apps/web with the prettier of
# its package-lock.json where npm has installed it (a build with tests does), as an editor does that formats when it saves.
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
root=$(dirname "$0")/..
if [[ $# -eq 0 ]]; then
  cd "$root"
  root=.
  mapfile -t all < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh' 'apps/web/*.js' 'apps/web/*.mjs')
  set -- "${all[@]}"
fi
files=() scripts=()
for file; do
  if [[ $file == *.js || $file == *.mjs ]]; then scripts+=("$file"); else files+=("$file"); fi
done

format_scripts() {
  local tool action=--write
  if [[ $check == yes ]]; then action=--check; fi
  for tool in "$root"/{apps/web,build/*/web}/node_modules/.bin/prettier; do
    if [[ -x $tool ]]; then "$tool" --log-level warn "$action" "${scripts[@]}"; return; fi
  done
  echo "JavaScript is left out: npm has not installed prettier" >&2
}
if [[ ${#scripts[@]} -gt 0 ]]; then format_scripts || die "the files above are not formatted; run scripts/format.sh"; fi
if [[ ${#files[@]} -eq 0 ]]; then exit; fi
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
