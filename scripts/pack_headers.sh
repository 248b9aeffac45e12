#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Copies the header-only dependencies and GoogleTest's sources from this machine into .deps (or DIR), for a
# server that has nvcc, g++, CMake and ninja and nothing else. There: cmake --preset minimal
set -euo pipefail
dir=$(realpath -m "${1:-$(dirname "$0")/../.deps}")
system=/usr/include
sources=/usr/src/googletest

mkdir -p "$dir/include/stb"
for library in glm toml++ CLI spdlog fmt nlohmann; do
  [[ -d $system/$library ]] || { echo "error: $system/$library was not found; run scripts/setup.sh first" >&2; exit 1; }
  rm -rf "${dir:?}/include/$library"
  cp -rL "$system/$library" "$dir/include/"
done
cp "$system"/stb/stb_image.h "$system"/stb/stb_image_write.h "$dir/include/stb/"
cp "$system/xxhash.h" "$dir/include/"

# libjpeg-turbo with its static library, where this machine has it: the viewer's frames are encoded in
# a seventh of stb_image_write's time.
machine=$(c++ -print-multiarch 2>/dev/null || true)
if [[ -e $system/jpeglib.h && -e /usr/lib/$machine/libjpeg.a ]]; then
  mkdir -p "$dir/lib"
  for header in jpeglib.h jmorecfg.h jerror.h "$machine/jconfig.h"; do cp "$system/$header" "$dir/include/"; done
  cp "/usr/lib/$machine/libjpeg.a" "$dir/lib/"
fi

# The pages of reports, of the viewer and of the studio, for a machine without npm, where a build here has made them.
builds=$(realpath -m "$(dirname "$0")/../build")
page=$(find "$builds" -path '*/web/report.html' -size +1k -printf '%T@ %p\n' 2>/dev/null | sort -n | sed -n '$s/^[^ ]* //p') || page=
if [[ -n $page ]]; then
  mkdir -p "$dir/web"
  cp "$page" "$dir/web/"
  for other in view.html studio.html; do
    if [[ -s ${page%report.html}$other ]]; then cp "${page%report.html}$other" "$dir/web/"; fi
  done
fi

rm -rf "$dir/googletest"
if [[ -d $sources ]]; then
  for part in googletest googlemock; do
    mkdir -p "$dir/googletest/$part"
    cp -rL "$sources/$part"/{CMakeLists.txt,cmake,include,src} "$dir/googletest/$part/"
  done
  cp "$sources/CMakeLists.txt" "$dir/googletest/"
fi
echo "$(du -sh "$dir" | cut -f1) in $dir"
