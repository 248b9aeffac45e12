#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds everything into build/default and runs the tests; arguments go to ctest (-R core, -j 1, ...).
set -euo pipefail
source "$(dirname "$0")/common.sh"

install_packages
build default all
ctest --test-dir build/default --output-on-failure --no-tests=error --progress -j"$(nproc)" "$@"
