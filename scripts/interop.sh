#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Exports read by the programs of others (tests/interop). Usage: scripts/interop.sh [PROGRAM [FOLDER [WEB CHROMIUM]]]
# With WEB, which holds playwright-core and view.html, it is the pictures of levels of detail in viewers that are compared.
# Packages go to FOLDER, of the versions in tests/interop/package-lock.json. Returns 77, and says why, where they cannot be had.
set -euo pipefail
source "$(dirname "$0")/common.sh"

program=$(realpath "${1:-build/default/bin/gemsplat}")
folder=${2:-build/interop}

skip() { printf 'skipped: %s\n' "$*"; exit 77; }

command -v node >/dev/null || skip "there is no node; install Node 20 or newer"
command -v npm >/dev/null || skip "there is no npm"
mkdir -p "$folder"
cp tests/interop/package.json tests/interop/package-lock.json "$folder/"
if ! cmp -s tests/interop/package-lock.json "$folder/node_modules/.lock-of-these"; then
  (cd "$folder" && npm ci --ignore-scripts --no-audit --no-fund >npm.log 2>&1) ||
    skip "npm cannot install the packages of tests/interop ($(tail -1 "$folder/npm.log"))"
  cp tests/interop/package-lock.json "$folder/node_modules/.lock-of-these"
fi
if [[ $# -lt 3 ]]; then
  GS_NODE_MODULES=$(realpath "$folder/node_modules") node tests/interop/check.mjs "$program" "$(realpath "$folder")/files"
  exit
fi
[[ -x $4 ]] || skip "no Chromium was found; install the package chromium"
node tests/interop/stream_test.mjs "$folder/node_modules" "$3" "$program" examples/courtyard "$folder/streams" "$4"
