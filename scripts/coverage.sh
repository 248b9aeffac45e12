#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Which share of the lines of each library the C++ tests run, by gcov in a build of its own.
#   scripts/coverage.sh                    all tests
#   scripts/coverage.sh core math          the folders tests/core and tests/math alone
# Lists of files with the lines that no test runs are in build/coverage/lines.txt.
set -euo pipefail
source "$(dirname "$0")/common.sh"

targets=(all) labels=.
if [[ $# -gt 0 ]]; then
  targets=("${@/%/_tests}")
  labels="^($(IFS='|'; echo "$*"))\$"
fi
build coverage "${targets[@]}"
find build/coverage -name '*.gcda' -delete  # of an earlier call
# A test that fails counts with the lines that it ran; the exit code says so at the end.
failed=0
ctest --test-dir build/coverage -L "$labels" -LE 'browser|interop|release' --no-tests=error --progress -j"$(nproc)" || failed=1
scripts/coverage.py build/coverage
exit $failed
