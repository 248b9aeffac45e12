#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds everything into build/default and runs the tests; arguments go to ctest (-R core, -j 1, ...).
set -euo pipefail
source "$(dirname "$0")/common.sh"

# say_skipped: how many tests were skipped for which reason, from CTest's log of this call.
say_skipped() {
  awk '
    is_reason && NF { count[$0]++ }
    { is_reason = /: Skipped$/ }
    /^skipped: / { count[substr($0, 10)]++ }
    END { for (reason in count) printf "== Skipped, %d: %s\n", count[reason], reason }' \
    build/default/Testing/Temporary/LastTest.log | sort
}

install_packages
build default all
failed=0
ctest --test-dir build/default --output-on-failure --no-tests=error --progress -j"$(nproc)" "$@" || failed=$?
say_skipped
exit $failed
