#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The same files give the same packages, whatever their times, their order and the umask are; and a
# build for the processor of one machine is not packed. Packs a small program, not gemsplat.
#   tests/release/packages_test.sh WORK_FOLDER
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
work=${1:?the folder to work in}
export SOURCE_DATE_EPOCH=1700000000

die() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
for tool in cmake cpack dpkg-deb dpkg-shlibdeps python3 readelf xz gzip c++; do
  command -v "$tool" >/dev/null || { echo "skipped: $tool is not installed"; exit 77; }
done
# shellcheck source=scripts/release/pack.sh
source "$root/scripts/release/pack.sh"

rm -rf "$work"
mkdir -p "$work"
echo 'int main() {}' | c++ -x c++ - -o "$work/program"
printf '# Changelog\n\n## [1.0] - 2026-01-02\n\n- A program that does nothing.\n' >"$work/CHANGELOG.md"
echo 'int answer() { return 42; }' >"$work/answer.cpp"

# stage FOLDER FILE...: an installed program whose files are made in that order.
stage() {
  local folder=$1 file
  shift
  for file in "$@"; do
    mkdir -p "$folder/$(dirname "$file")"
    cp "$work/program" "$folder/$file"
  done
}

# packed NAME UMASK FILE...: tar, wheel and deb in WORK/NAME/out.
packed() {
  local tree=$work/$1
  umask "$2"
  shift 2
  stage "$tree/stage/gemsplat-1.0-linux" "$@"
  # Objects name their source, as nvcc's do with a name that changes each time.
  cp "$work/answer.cpp" "$work/$(basename "$tree").cpp"
  c++ -c "$work/$(basename "$tree").cpp" -o "$tree/answer.o"
  mkdir -p "$tree/stage/gemsplat-1.0-linux/lib"
  ar rcs "$tree/stage/gemsplat-1.0-linux/lib/libanswer.a" "$tree/answer.o"
  stage "$tree/module" gemsplat/_gemsplat.cpython-31{1,2}-x86_64-linux-gnu.so
  pack_deb "$tree" OFF || die "$(cat "$tree/cpack.log")"
  rm -r "$tree/stage/gemsplat-1.0-linux/lib"  # libraries are in a Debian package alone
  pack_tar "$tree/stage/gemsplat-1.0-linux" "$tree/out"
  python3 "$root/scripts/release/wheel.py" --module "$tree/module" --program "$tree/stage/gemsplat-1.0-linux" \
    --version 1.0 "$tree/out" >/dev/null
}

# pack_deb TREE NATIVE: with the scripts that scripts/cmake/package.cmake names.
pack_deb() {
  cat >"$1/CPackConfig.cmake" <<EOF_CMAKE
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME gemsplat)
set(CPACK_PACKAGE_VERSION 1.0)
set(CPACK_PACKAGE_FILE_NAME gemsplat-1.0)
set(CPACK_PACKAGE_CONTACT "Nobody <nobody@nowhere.invalid>")
set(CPACK_DEBIAN_PACKAGE_RELEASE 1~bookworm)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_GS_CHANGELOG "$work/CHANGELOG.md")
set(CPACK_GS_PYTHON3 python3)
set(CPACK_PACKAGE_DESCRIPTION "A program that does nothing.")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_INSTALLED_DIRECTORIES "$1/stage/gemsplat-1.0-linux;usr")
set(CPACK_GS_NATIVE $2)
set(CPACK_PROJECT_CONFIG_FILE "$root/scripts/cmake/check_package.cmake")
set(CPACK_PRE_BUILD_SCRIPTS "$root/scripts/cmake/finish_package.cmake")
EOF_CMAKE
  (umask 022; cpack --config "$1/CPackConfig.cmake" -B "$1/out" >"$1/cpack.log" 2>&1)  # as release.sh does
}

check_same_bytes() {
  local file count=0
  packed first 022 bin/gemsplat share/doc/gemsplat/NOTICE share/man/man1/gemsplat.1
  sleep 1.1  # the second gets other time stamps
  packed second 077 share/man/man1/gemsplat.1 share/doc/gemsplat/NOTICE bin/gemsplat
  for file in "$work"/first/out/*.{deb,tar.gz,tar.xz,whl}; do
    cmp "$file" "$work/second/out/$(basename "$file")" || die "$(basename "$file") differs"
    count=$((count + 1))
  done
  [[ $count -eq 5 ]] || die "there are $count packages"
}

check_contents() {
  local out=$work/first/out python
  dpkg-deb -c "$out"/*.deb >"$work/deb.txt"
  grep -q 'root/root.* ./usr/bin/gemsplat$' "$work/deb.txt" || die "$(cat "$work/deb.txt")"
  grep -q './usr/share/man/man1/gemsplat.1.gz$' "$work/deb.txt" || die "the man page is not compressed"
  grep -q './usr/share/doc/gemsplat/copyright$' "$work/deb.txt" || die "there is no copyright file"
  dpkg-deb --fsys-tarfile "$out"/*.deb | tar -xO ./usr/share/doc/gemsplat/changelog.Debian.gz | gzip -d >"$work/changelog.txt"
  grep -q '^gemsplat (1.0-1~bookworm) bookworm;' "$work/changelog.txt" || die "the changelog is $(cat "$work/changelog.txt")"
  dpkg-deb -f "$out"/*.deb Depends >"$work/depends.txt"
  grep -q libc6 "$work/depends.txt" || die "the package does not depend on libc6"
  tar -tvf "$out"/*.tar.xz >"$work/tar.txt"
  grep -q '^-rwxr-xr-x 0/0 .*gemsplat-1.0-linux/bin/gemsplat$' "$work/tar.txt" || die "$(cat "$work/tar.txt")"
  for python in 311 312; do
    python3 -m zipfile -l "$out"/gemsplat-1.0-cp$python-cp$python-manylinux_2_*.whl >"$work/wheel.txt"
    grep -q 'gemsplat-1.0.data/scripts/gemsplat ' "$work/wheel.txt" || die "$(cat "$work/wheel.txt")"
    [[ $(grep -o '_gemsplat[^ ]*' "$work/wheel.txt") == _gemsplat.cpython-$python-x86_64-linux-gnu.so ]] || die "$(cat "$work/wheel.txt")"
    python3 - "$out"/gemsplat-1.0-cp$python-*.whl >"$work/requires.txt" <<'EOF_PYTHON'
import importlib.metadata, sys, zipfile
wheel = importlib.metadata.PathDistribution(zipfile.Path(sys.argv[1]) / "gemsplat-1.0.dist-info")
extras = wheel.metadata.get_all("Provides-Extra")
print(*(f"[{next((extra for extra in extras if f'extra == {extra!r}' in line), '')}]{line.split()[0]}" for line in wheel.requires))
EOF_PYTHON
    [[ $(cat "$work/requires.txt") == "[]numpy [torch]torch [jax]jax [cupy]cupy-cuda12x" ]] || die "$(cat "$work/requires.txt")"
  done
}

check_native_is_refused() {
  local tree=$work/native
  mkdir -p "$tree"
  stage "$tree/stage/gemsplat-1.0-linux" bin/gemsplat
  if pack_deb "$tree" ON; then die "cpack packed a native build"; fi
  grep -q 'GS_NATIVE=ON' "$tree/cpack.log" || die "$(cat "$tree/cpack.log")"
  echo 'GS_NATIVE:BOOL=ON' >"$tree/CMakeCache.txt"
  if refuse_native "$tree" 2>"$tree/error"; then die "release.sh packs a native build"; fi
  echo 'GS_NATIVE:BOOL=OFF' >"$tree/CMakeCache.txt"
  refuse_native "$tree" || die "release.sh refuses a build for every machine"
}

check_wrong_usage() {
  local flag words
  if copy_sysroot "$work" "$work/sysroot" 2>"$work/error"; then die "release.sh links with a system that has no C library"; fi
  grep -q 'has no libc6-dev' "$work/error" || die "$(cat "$work/error")"
  for flag in "--out" "--sysroot" "--python" "--python /" "--architectures" "--nonsense" "rpm"; do
    read -ra words <<<"$flag"
    if "$root/scripts/release.sh" "${words[@]}" >/dev/null 2>"$work/error"; then die "release.sh takes $flag"; fi
    grep -q '^error: ' "$work/error" || die "$flag: $(cat "$work/error")"
  done
}

# The flags of a system's folder are all that a program needs: CMake links its first one with them alone.
check_sysroot() {
  local flags
  (cd "$root" && copy_sysroot / "$work/system" && sysroot_flags "$work/system" >"$work/flags")
  read -r -a flags <"$work/flags"
  printf '%s\n' '#include <cstdio>' 'int main() { try { throw 7; } catch (int n) { std::printf("%d\n", n); } }' >"$work/throw.cpp"
  c++ -c "$work/throw.cpp" -o "$work/throw.o"  # headers are those of this system
  c++ "${flags[@]}" "$work/throw.o" -o "$work/throw"
  [[ $("$work/throw") == 7 ]] || die "exceptions do not work in a program linked with a system's folder"
  readelf -dW "$work/throw" >"$work/throw.txt"
  if grep -E 'NEEDED.*lib(stdc\+\+|gcc_s)' "$work/throw.txt"; then die "the compiler's runtime is not inside"; fi
}

# A tag of an action can be moved; a hash cannot.
check_actions_are_pinned() {
  local file=$root/.github/workflows/release.yml
  [[ $(grep -c 'uses:' "$file") -ge 4 ]] || die "$file uses few actions"
  if grep 'uses:' "$file" | grep -vE '@[0-9a-f]{40} '; then die "an action is not pinned by its hash"; fi
}

check_actions_are_pinned
check_same_bytes
check_contents
check_native_is_refused
check_sysroot
check_wrong_usage
