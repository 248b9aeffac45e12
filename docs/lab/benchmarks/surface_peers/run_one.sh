#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the peers, if that was not done, trains one of them on one scene, and measures its mesh:
#   run_one.sh gggs|rade SCENE [STEPS]
# SCENE is the folder of a COLMAP scene, with truth.ply where its surface is known.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
export PEERS=${PEERS:-/tmp/peers} OMP_NUM_THREADS=${OMP_NUM_THREADS:-2} PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
mkdir -p "$PEERS"
(
  flock 9
  [[ -e $PEERS/built ]] || { python3 "$here/build.py" "$PEERS" "${MAX_JOBS:-$(nproc)}" && touch "$PEERS/built"; }
) 9>"$PEERS/build.lock"
exec python3 "$here/run_one.py" "$@"
