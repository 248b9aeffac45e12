#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Formats C++ and CUDA sources with clang-format 14, but leaves the comments at the ends of lines where they
# were put by hand: the tables of shapes and units.
#   scripts/format.sh [FILE...]           formats these files, or every tracked one
#   scripts/format.sh --check [FILE...]   changes nothing, shows what would change, fails if anything would
set -euo pipefail

check=no
if [[ ${1:-} == --check ]]; then check=yes; shift; fi
if [[ $# -gt 0 ]]; then
  files=("$@")
else
  cd "$(dirname "$0")/.."
  mapfile -t files < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh')
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Each comment at the end of a line becomes //@NUMBER, and a line "code TAB spaces TAB comment" of the file
# `kept`; so does a comment on a line of its own straight below one. Namespace ends are clang-format's affair.
take_comments_out() {
  awk -v kept="$1" '
    BEGIN { printf "" > kept }
    {
      taken = 0
      if (match($0, /[ \t]+\/\//) && !/^}/) {
        code = substr($0, 1, RSTART - 1)
        spaces = substr($0, RSTART, RLENGTH - 2)
        quotes = gsub(/"/, "\"", code)
        taken = quotes % 2 == 0 && (code != "" || below)
      }
      if (taken) {
        number += 1
        printf "%s\t%s\t%s\n", code, spaces, substr($0, RSTART + RLENGTH - 2) > kept
        print code spaces "//@" number
      } else {
        print
      }
      below = taken
    }'
}

# A line of code that did not change gets its comment back where it stood, another two spaces behind the code.
put_comments_back() {
  awk -F '\t' -v kept="$1" '
    BEGIN { while ((getline < kept) > 0) { n += 1; code[n] = $1; spaces[n] = $2; comment[n] = $3 } }
    {
      if (match($0, /[ \t]*\/\/@[0-9]+$/)) {
        before = substr($0, 1, RSTART - 1)
        number = $0
        sub(/.*\/\/@/, "", number)
        number += 0
        print before (before == code[number] ? spaces[number] : "  ") comment[number]
      } else {
        print
      }
    }'
}

changed=0
for file in "${files[@]}"; do
  take_comments_out "$work/kept" <"$file" >"$work/bare"
  clang-format --assume-filename="$PWD/$file" <"$work/bare" | put_comments_back "$work/kept" >"$work/formatted"
  cmp -s "$file" "$work/formatted" && continue
  changed=$((changed + 1))
  if [[ $check == yes ]]; then
    diff -u --label "$file" --label "$file, formatted" "$file" "$work/formatted" || true
  else
    cat "$work/formatted" >"$file"
    echo "formatted $file"
  fi
done
[[ $check == no || $changed -eq 0 ]] || { echo "$changed files to format: scripts/format.sh" >&2; exit 1; }
