#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# SPDX-FileCopyrightText: The gemsplat authors
#
# Camera poses and points of the courtyard set from its pictures alone (COLMAP 3.8, CPU).
#   ./reconstruct.sh [WORK_FOLDER]     (default /tmp/scene/colmap; it is emptied first)
# Writes sparse/0 beside this script.  The database and COLMAP's unpruned model stay in
# WORK_FOLDER.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
work=${1:-/tmp/scene/colmap}
export QT_QPA_PLATFORM=offscreen   # Debian's colmap links Qt and has no display here

rm -rf "$work"
mkdir -p "$work/sparse"

colmap feature_extractor \
    --database_path "$work/database.db" --image_path "$here/images" \
    --ImageReader.camera_model PINHOLE --ImageReader.single_camera 1 \
    --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 3000

colmap exhaustive_matcher \
    --database_path "$work/database.db" \
    --SiftMatching.use_gpu 0

colmap mapper \
    --database_path "$work/database.db" --image_path "$here/images" \
    --output_path "$work/sparse"

# Keypoints that saw no 3D point are two thirds of the file and of no use to a trainer.
rm -rf "$here/sparse/0"
mkdir -p "$here/sparse/0"
python3 "$here/prune_model.py" "$work/sparse/0" "$here/sparse/0"

colmap model_analyzer --path "$here/sparse/0"
