#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Exports read by the programs of others (tests/interop). Usage: scripts/interop.sh [PROGRAM [FOLDER [WEB [CHROMIUM]]]]
# With WEB, which holds playwright-core and view.html, it is the pictures of levels of detail in our page that are compared.
# Packages go to FOLDER, of the versions in tests/interop/package-lock.json. Returns 77, and says why, where they cannot be had.
set -euo pipefail
source "$(dirname "$0")/common.sh"

program=$(realpath "${1:-build/default/bin/gemsplat}")
folder=${2:-build/interop}

if [[ $# -lt 3 ]]; then
  install_npm_packages tests/interop "$folder"
  GS_NODE_MODULES=$(realpath "$folder/node_modules") node tests/interop/check.mjs "$program" "$(realpath "$folder")/files"
  exit
fi
chromium=$(find_chromium "${4:-}")
node tests/interop/stream_test.mjs "$3" "$program" examples/courtyard "$folder/streams" "$chromium"
