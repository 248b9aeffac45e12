#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Packs the fuzz targets for a Linux machine of the same architecture that has neither compiler nor
# libraries: FOLDER gets the programs, their libraries, the seeds and run.sh. OpenImageIO and OpenCV
# would bring 260 libraries, so the targets are built without them, and small JPEG and PNG are decoded
# by stb_image.
#   scripts/fuzz_bundle.sh FOLDER
set -euo pipefail
source "$(dirname "$0")/common.sh"

[[ $# == 1 ]] || die "usage: scripts/fuzz_bundle.sh FOLDER"
mkdir -p "$1"
bundle=$(cd "$1" && pwd)
readonly bundle tree=build/fuzz_small

# Whether a library belongs to the C library, which every machine has in its own version.
is_of_the_system() { [[ ${1##*/} =~ ^(ld-linux.*|lib(c|m|dl|rt|pthread|resolv|util))\.so ]]; }

install_clang
cmake --preset fuzz -B $tree -DGS_WITH_OPENIMAGEIO=OFF -DGS_WITH_OPENCV=OFF -DGS_WITH_CERES=OFF
ninja -C $tree fuzz_targets
rm -rf "${bundle:?}"/{bin,lib,seeds,dictionaries}
mkdir "$bundle"/{bin,lib,dictionaries}
for target in tests/fuzz/corpus/*; do
  program=fuzz_${target##*/}
  strip --strip-all -o "$bundle/bin/$program" "$tree/tests/$program"
  while read -r library; do
    if ! is_of_the_system "$library"; then cp -u "$library" "$bundle/lib/"; fi
  done < <(ldd "$tree/tests/$program" | awk '/=> \// { print $3 }')
done
cp -r tests/fuzz/corpus "$bundle/seeds"
cp tests/fuzz/*.dict "$bundle/dictionaries/"
cp tests/fuzz/run_bundle.sh "$bundle/run.sh"
programs=("$bundle"/bin/*)
say "$bundle/run.sh SECONDS OUTPUT runs the ${#programs[@]} targets ($(du -sh "$bundle" | cut -f1))"
