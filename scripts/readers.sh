#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which program reads which of our files (tests/interop/readers). Usage: scripts/readers.sh [PROGRAM [FOLDER [CHROMIUM [--write]]]]
# Packages go to FOLDER, of the versions in tests/interop/readers/package-lock.json. --write puts the result into
# docs/formats/readers.md and docs/formats/readers.json; otherwise a difference from the latter is
# an error. Returns 77, and says why, where packages or Chromium cannot be had.
set -euo pipefail
source "$(dirname "$0")/common.sh"

program=$(realpath "${1:-build/default/bin/gemsplat}")
folder=${2:-build/readers}
chromium=$(find_chromium "${3:-}")

install_npm_packages tests/interop/readers "$folder"
node tests/interop/readers/matrix.mjs "$(realpath "$folder")" "$program" "$(realpath "$folder")/files" "$chromium" ${4:+"$4"}
