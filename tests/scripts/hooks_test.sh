#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes commits in a repository of its own with the hooks of scripts/hooks, and checks which ones are refused, and why.
#   tests/scripts/hooks_test.sh WORK_FOLDER
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
work=${1:?the folder to work in}
command -v git >/dev/null || { echo "skipped: git is not installed"; exit 77; }

die() { printf 'FAILED: %s\n' "$*" >&2; cat "$work/output" >&2; exit 1; }

# A repository with the hooks and their tools, away from the settings of the user who runs this.
make_repository() {
  rm -rf "$work"
  mkdir -p "$work/home" "$work/repository/scripts"
  unset "${!GIT_@}"
  export HOME=$work/home XDG_CONFIG_HOME=$work/home GIT_CONFIG_NOSYSTEM=1 GIT_CEILING_DIRECTORIES=$work
  : >"$work/output"
  cd "$work/repository"
  git init -q .
  git config user.name Test
  git config user.email test@example.org
  cp "$root/.clang-format" .
  cp -r "$root/scripts/format.sh" "$root/scripts/hooks" scripts/
  git add .
  git commit -q -m "Begin"
  git config core.hooksPath scripts/hooks
}

commits() { git rev-list --count HEAD; }

# accepts MESSAGE: what is staged becomes a commit.
accepts() {
  local before
  before=$(commits)
  git commit -m "$1" >"$work/output" 2>&1 || die "refused: $1"
  [[ $(commits) -eq $((before + 1)) ]] || die "no commit was made: $1"
}

# refuses MESSAGE REASON: no commit is made, and the output says why. Takes the changes back.
refuses() {
  if git commit -m "$1" >"$work/output" 2>&1; then die "accepted: $1"; fi
  grep -q -- "$2" "$work/output" || die "'$2' is not in the output"
  git reset -q --hard
}

# stage FILE TEXT
stage() {
  mkdir -p "$(dirname "$1")"
  printf '%s\n' "$2" >"$1"
  git add -- "$1"
}

test_shell_scripts() {
  stage good.sh 'if true; then echo yes; fi'
  accepts "Add a script that parses"
  stage bad.sh 'if true; then echo yes'
  refuses "Add a script that does not parse" "bad.sh does not parse"
  stage 'tools/no ending' $'#!/usr/bin/env bash\necho "'
  refuses "Add a script without an ending" "tools/no ending does not parse"
  stage script.py $'#!/usr/bin/env python3\nprint("if true; then")'
  accepts "Add a script of another language"
  stage good.sh 'if true'
  printf 'echo mended\n' >good.sh  # not staged
  refuses "Stage a script that parses only in the folder" "good.sh does not parse"
}

test_sizes() {
  head -c $((1 << 20)) /dev/zero >picture.bin
  git add picture.bin
  accepts "Add a file of 1 MiB"
  head -c $(((1 << 20) + 1)) /dev/zero >film.bin
  git add film.bin
  refuses "Add a larger file" "film.bin has 1048577 bytes"
  git rm -q picture.bin
  accepts "Remove a file"
  ln -s good.sh link.sh
  git add link.sh
  accepts "Add a symbolic link"
}

test_format() {
  if ! command -v clang-format >/dev/null; then
    stage bad.cpp 'int  x ;'
    accepts "Format is not checked without clang-format"
    grep -q "clang-format is not installed" "$work/output" || die "nothing is said of clang-format"
    return
  fi
  stage 'src/two words.cpp' 'int x;'
  accepts "Add a formatted file"
  stage bad.cpp 'int  x ;'
  refuses "Add a file that is not formatted" "some files are not formatted"
  stage 'src/two words.cpp' 'int y;'
  printf 'int  y ;\n' >'src/two words.cpp'  # not staged
  accepts "Stage a formatted file"
  git checkout -q .
}

test_messages() {
  local characters_72
  characters_72=$(printf 'a%.0s' {1..72})
  stage file.txt 1
  accepts "$characters_72"
  stage file.txt 2
  refuses "${characters_72}a" "the subject has 73 characters"
  stage file.txt 3
  accepts "${characters_72/aaaa/äöüß}"
  stage file.txt 4
  refuses "Change a file." "ends with a period"
  stage file.txt 5
  refuses $'Change a file\nand say no more' "the second line is not empty"
  stage file.txt 6
  accepts $'Change a file\n\nThe body may have lines as long as it takes, and may end with a period, as this long one does.'
  stage file.txt 7
  accepts "Merge branch 'of-a-name-that-makes-the-subject-longer-than-anybody-would-write-it-by-hand'"
  stage file.txt 8
  git commit --no-verify -q -m "Not looked at."
}

make_repository
test_shell_scripts
test_sizes
test_format
test_messages
echo "passed"
