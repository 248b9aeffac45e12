#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Times calls of `gemsplat --version`, one after the other. Usage: scripts/bench_startup.sh [CALLS [PROGRAM]]
set -euo pipefail
source "$(dirname "$0")/common.sh"

calls=${1:-1000}
program=${2:-build/default/bin/gemsplat}
[[ -x $program ]] || die "there is no program $program; run scripts/setup.sh first"
start=$(date +%s.%N)
for ((i = 0; i < calls; i++)); do "$program" --version >/dev/null; done
LC_ALL=C awk -v calls="$calls" -v start="$start" -v end="$(date +%s.%N)" \
  'BEGIN { printf "%d calls: %.1f s, %.1f ms each\n", calls, end - start, 1e3 * (end - start) / calls }'
