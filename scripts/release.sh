#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the packages of a release from the commit that is checked out (docs/develop/releases.md):
#   scripts/release.sh [deb] [tar] [wheel] [--without-cuda] [--architectures LIST] [--sysroot DIR] [--python DIR]... [--out DIR] [--uncommitted]
#     deb             Debian packages for the distribution of this machine, with every library
#     tar             an archive for any Linux, without libraries under the GPL
#     wheel           the same program and the Python module, for the Python of /usr/bin/python3 and those of --python
#     --without-cuda  leaves out the GPU backend; the packages compute on the CPU alone
#     --architectures LIST   GPUs to compile for, as CMake names them ("90-real;120") [all seven]; for trying this script
#     --sysroot DIR   link tar and wheel with the C library of the older system in DIR (Debian: libc6-dev)
#     --python DIR    a wheel for the CPython whose headers are in DIR, too; may be given several times
#     --out DIR       where to [build/release]
#     --uncommitted   pack changes that are not committed, too; for trying this script
# Without deb, tar and wheel it makes all three. The same commit gives the same bytes on the same system.
set -euo pipefail

usage() { sed -n '4,14s/^# //p' "$0"; }
wrong_usage() { echo "error: $*" >&2; usage >&2; exit 2; }

out=build/release
kinds=()
cuda=(-DGS_WITH_CUDA=ON -DGS_REQUIRE_CUDA=ON)
sysroot=
pythons=''
uncommitted=no
while [[ $# -gt 0 ]]; do
  case $1 in
    deb | tar | wheel) kinds+=("$1"); shift ;;
    --without-cuda) cuda+=(-DGS_WITH_CUDA=OFF -DGS_REQUIRE_CUDA=OFF); shift ;;
    --uncommitted) uncommitted=yes; shift ;;
    --architectures)
      [[ $# -gt 1 ]] || wrong_usage "$1 needs a list of GPU architectures"
      cuda+=("-DGS_CUDA_ARCHITECTURES=$2"); shift 2 ;;
    --sysroot | --out | --python)
      [[ $# -gt 1 ]] || wrong_usage "$1 needs a folder"
      case $1 in
        --out) out=$2 ;;
        --sysroot) sysroot=$(realpath "$2") ;;
        --python)
          [[ -f $2/Python.h ]] || wrong_usage "$2 has no Python.h"
          pythons+=${pythons:+;}$(realpath "$2") ;;
      esac
      shift 2 ;;
    -h | --help) usage; exit ;;
    *) wrong_usage "there is no flag or package $1" ;;
  esac
done
[[ ${#kinds[@]} -gt 0 ]] || kinds=(deb tar wheel)
out=$(realpath -m "$out")
source "$(dirname "$0")/common.sh"
source scripts/release/pack.sh
umask 022

wanted() { [[ " ${kinds[*]} " == *" $1 "* ]]; }

# Time stamps of packages are those of the commit.
choose_time() {
  if [[ $uncommitted == no && -n $(git status --porcelain --untracked-files=no) ]]; then
    die "there are changes that are not committed: commit them, or add --uncommitted"
  fi
  export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
}

# build_for_release PRESET FLAG...: all that is installed, with pages and notices of this commit's time.
build_for_release() {
  local preset=$1
  shift
  cmake --preset "$preset" --log-level=NOTICE "${cuda[@]}" "$@"
  refuse_native "build/$preset"
  rm -rf "build/$preset/share" "build/$preset/notices"
  say "Building build/$preset"
  cmake --build "build/$preset" -j "$(nproc)" --target installed
}

# check_needed BUILD FLAG FILE...: programs load no library that has no row in third_party.json.
check_needed() {
  local tree=$1 flag=$2
  shift 2
  python3 scripts/release/notices.py check --have "$(cache_value "$tree" GS_BUILD_HAS)" ${flag:+"$flag"} "$@"
}

make_debs() {
  local tree=build/package
  build_for_release package
  check_needed "$tree" '' "$tree"/bin/gemsplat "$tree"/lib/gemsplat/*.so "$tree"/python/gemsplat/*.so
  rm -f "$tree"/*.deb
  (cd "$tree" && cpack -G DEB >cpack.log) || { tail -n 20 "$tree/cpack.log" >&2; die "cpack failed: $tree/cpack.log"; }
  cp "$tree"/*.deb "$out/"
}

# Installs the tarball's build into build/tarball/stage, which tar and wheel are made of.
stage_tarball() {
  local tree=build/tarball flags=''
  if [[ -n $sysroot ]]; then
    copy_sysroot "$sysroot" "$PWD/$tree/sysroot"
    flags=$(sysroot_flags "$PWD/$tree/sysroot")
  fi
  build_for_release tarball "-DGS_PYTHON_HEADERS=$pythons" "-DCMAKE_EXE_LINKER_FLAGS=$flags" "-DCMAKE_MODULE_LINKER_FLAGS=$flags"
  check_needed "$tree" --static "$tree"/bin/gemsplat "$tree"/python/gemsplat/*.so
  rm -rf "$tree/stage"
  cmake --install "$tree" --strip --component program --prefix "$tree/stage/$folder" >/dev/null
  cmake --install "$tree" --strip --component python --prefix "$tree/stage/module" >/dev/null
}

choose_time
version=$(sed -n 's/^project(gemsplat VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
folder=gemsplat-$version-linux-$(uname -m)
mkdir -p "$out"
if wanted deb; then make_debs; fi
if wanted tar || wanted wheel; then stage_tarball; fi
if wanted tar; then pack_tar "build/tarball/stage/$folder" "$out"; fi
if wanted wheel; then
  python3 scripts/release/wheel.py --module build/tarball/stage/module/lib/python3/dist-packages \
    --program "build/tarball/stage/$folder" --version "$version" "$out" >/dev/null
fi
(cd "$out" && find . -maxdepth 1 -type f \( -name '*.deb' -o -name '*.tar.?z' -o -name '*.whl' \) -printf '%P\n' |
  LC_ALL=C sort | xargs sha256sum >SHA256SUMS)
say "In $out:"
find "$out" -maxdepth 1 -type f -printf "   %f: %s bytes\n" | sort
