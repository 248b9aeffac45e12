#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Starts jobs in the background, which outlive this command, and returns:
#   all.sh PEER:SCENE[:STEPS]...
# Logs and results.csv gather in /tmp/peers/out.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=${PEERS:-/tmp/peers}/out
mkdir -p "$out"
for job in "$@"; do
  IFS=: read -r peer scene steps <<<"$job"
  name=$peer-$(basename "$scene")
  setsid nohup "$here/run_one.sh" "$peer" "$scene" ${steps:+"$steps"} >"$out/$name.log" 2>&1 </dev/null &
  echo "started $name"
done
