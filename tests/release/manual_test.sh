#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Man pages and completions that `gemsplat self-doc` writes. Each part is one test:
#   tests/release/manual_test.sh man|bash|zsh|fish GEMSPLAT WORK_FOLDER
set -euo pipefail
part=${1:?man, bash, zsh or fish}
program=${2:?the program}
work=${3:?the folder to work in}

die() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
need() { command -v "$1" >/dev/null || { echo "skipped: $1 is not installed"; exit 77; }; }

rm -rf "$work"
mkdir -p "$work"
SOURCE_DATE_EPOCH=86400 "$program" self-doc "$work"
pages=$work/man/man1

# Each verb has a page, and each flag of --help-all is on it.
check_pages() {
  local verb page flag verbs
  verbs=$("$program" --help | sed -n 's/^  \([a-z][a-z-]*\) .*/\1/p')
  [[ $(wc -w <<<"$verbs") -ge 16 ]] || die "--help lists few verbs: $verbs"
  for verb in $verbs; do
    page=$pages/gemsplat-$verb.1
    [[ -s $page ]] || die "$verb has no page"
    for flag in $("$program" "$verb" --help-all | grep -oE '^  -[^ ]+' | sed 's/,/ /g'); do
      grep -qF -- "\\fB${flag//-/\\-}\\fR" "$page" || die "$page lacks $flag"
    done
  done
  grep -q '1970-01-02' "$pages/gemsplat.1" || die "the date is not that of SOURCE_DATE_EPOCH"
  grep -qF '[\fIscene\fR]' "$pages/gemsplat-train.1" || die "the synopsis of train lacks its scene"
  [[ -s $pages/gemsplat-config-diff.1 ]] || die "a verb of a verb has no page"
  [[ $("$program" --help) != *self-doc* ]] || die "--help lists self-doc"
}

check_nothing_is_replaced() {
  echo mine >"$pages/gemsplat.1"
  if "$program" self-doc "$work" 2>"$work/error"; then die "a file was replaced"; fi
  grep -q 'gemsplat.* exists; --replace' "$work/error" || die "the error is $(cat "$work/error")"
  [[ $(cat "$pages/gemsplat.1") == mine ]] || die "a file was replaced after all"
  "$program" self-doc "$work" --replace
  grep -q '^.TH' "$pages/gemsplat.1" || die "--replace replaced nothing"
}

# complete WORD...: what bash offers for the last word.
complete_words() {
  COMP_WORDS=("$@")
  COMP_CWORD=$(($# - 1))
  _gemsplat
  echo "${COMPREPLY[*]}"
}

# expect EXPECTED WORD...
expect() {
  local expected=$1 found
  shift
  found=$(complete_words "$@")
  [[ $found == "$expected" ]] || die "bash completes '$*' to '$found' instead of '$expected'"
}

check_bash() {
  local script=$work/bash-completion/completions/gemsplat
  bash -n "$script"
  # shellcheck source=/dev/null
  source "$script"
  expect train gemsplat tr
  expect "--viewer --viewer-host --viewer-port --viewer-wait" gemsplat train scene --viewer
  expect "cpu cuda" gemsplat train --device c
  expect "explain" gemsplat config ex
  expect "" gemsplat train --seed 4
  expect "cpu_tiny" gemsplat train -c cpu
  mkdir -p "$work/place/folder" && touch "$work/place/file"
  cd "$work/place"
  expect folder gemsplat train -o f
  expect "file folder" gemsplat info f
}

check_zsh() {
  need zsh
  local script=$work/zsh/site-functions/_gemsplat
  zsh -n "$script"
  [[ $(head -n 1 "$script") == "#compdef gemsplat" ]] || die "zsh would not find the script"
  # The completion system needs a terminal; here its functions print what they are given.
  zsh -f -c "_arguments() { print -rl -- \"\$@\" }; _describe() { print -r -- \"\$@\" }
    functions[complete]=\"\$(<'$script')\"; complete gemsplat" >"$work/zsh.log" 2>&1 || die "$(cat "$work/zsh.log")"
  grep -q '1: :->verb' "$work/zsh.log" || die "zsh got no verbs: $(cat "$work/zsh.log")"
  grep -q "'train:Train Gaussians" "$script" || die "zsh does not describe train"
}

check_fish() {
  need fish
  local script=$work/fish/vendor_completions.d/gemsplat.fish
  fish --no-execute "$script"
  HOME=$work fish -c "source '$script'; complete -C 'gemsplat tr'" >"$work/fish.log" 2>"$work/fish.err" ||
    die "$(cat "$work/fish.err")"
  grep -q '^train' "$work/fish.log" || die "fish completes 'gemsplat tr' to $(cat "$work/fish.log")"
  HOME=$work fish -c "source '$script'; complete -C 'gemsplat train --dev'" >"$work/fish.log"
  grep -q '^--device' "$work/fish.log" || die "fish completes --dev to $(cat "$work/fish.log")"
}

case $part in
  man)
    check_pages
    check_nothing_is_replaced
    need mandoc
    mandoc -T lint -W warning "$pages"/*.1 >"$work/lint" || die "$(head -n 20 "$work/lint")"
    ;;
  bash) check_bash ;;
  zsh) check_zsh ;;
  fish) check_fish ;;
  *) die "there is no part $part" ;;
esac
