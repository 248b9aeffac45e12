#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Our tilesets in CesiumJS (tests/interop/cesium). Usage: scripts/cesium.sh [PROGRAM [FOLDER [CHROMIUM]]]
# Packages go to FOLDER, of the versions in tests/interop/cesium/package-lock.json. Returns 77, and says why, where they
# or Chromium cannot be had.
set -euo pipefail
source "$(dirname "$0")/common.sh"

program=$(realpath "${1:-build/default/bin/gemsplat}")
folder=${2:-build/cesium}
chromium=$(find_chromium "${3:-}")

install_npm_packages tests/interop/cesium "$folder"
node tests/interop/cesium/tileset_test.mjs "$(realpath "$folder")" "$program" "$(realpath "$folder")/files" "$chromium" examples/courtyard
