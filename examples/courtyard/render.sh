#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# SPDX-FileCopyrightText: The gemsplat authors
#
# Render the courtyard's photos anew: rounds of few samples, then the noise filter.
#   ./render.sh [WORK_FOLDER [ROUNDS]]     (default /tmp/scene/render, 2 rounds)
# Needs Debian's blender and python3-numpy.  Replaces images/ beside this script; run
# reconstruct.sh afterwards, since the sparse model belongs to the very pictures.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
work=${1:-/tmp/scene/render}
rounds=${2:-2}
export PYTHONDONTWRITEBYTECODE=1

folders=
round=0
while [ "$round" -lt "$rounds" ]; do
    nice -n 10 blender -b --python-exit-code 1 -P "$here/make_scene.py" -- \
        --out "$work/round$round" --round "$round"
    folders="$folders $work/round$round"
    round=$((round + 1))
done

rm -rf "$here/images"
# shellcheck disable=SC2086  # the folders are words on purpose
nice -n 10 blender -b --python-exit-code 1 -P "$here/develop.py" -- --out "$here/images" $folders
