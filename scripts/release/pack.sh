# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# Steps of scripts/release.sh that its tests call, too; sourced by both. Needs SOURCE_DATE_EPOCH.

# cache_value BUILD NAME: a variable of CMake.
cache_value() { sed -n "s/^$2:[A-Z]*=//p" "$1/CMakeCache.txt"; }

# refuse_native BUILD: other machines may lack instructions of this one.
refuse_native() {
  [[ $(cache_value "$1" GS_NATIVE) == OFF ]] && return
  echo "error: $1 is built for the processor of this machine (GS_NATIVE is not OFF) and cannot be packed" >&2
  return 1
}

# pack_tar FOLDER OUT: OUT/NAME.tar.gz and .tar.xz of FOLDER, whose name they have. The order, the
# owner and the times of its files do not matter, nor does the umask.
pack_tar() {
  local name
  name=$(basename "$1")
  mkdir -p "$2"
  tar --create --directory "$(dirname "$1")" --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 \
    --numeric-owner --mode='u=rwX,go=rX' --format=gnu --file "$2/$name.tar" "$name"
  gzip -9n <"$2/$name.tar" >"$2/$name.tar.gz"
  xz -6 --threads=1 <"$2/$name.tar" >"$2/$name.tar.xz"
  rm "$2/$name.tar"
}

# resolved ROOT FILE: where the links of ROOT lead to, with absolute ones inside of ROOT.
resolved() {
  local path=$1/$2 target
  while [[ -L $path ]]; do
    target=$(readlink "$path")
    case $target in
      /*) path=$1$target ;;
      *) path=$(dirname "$path")/$target ;;
    esac
  done
  echo "$path"
}

# copy_sysroot ROOT OUT: what a program is linked with of ROOT's C library (Debian: libc6-dev).
copy_sysroot() {
  local root=$1 out=$2 machine folder file
  machine=$(c++ -print-multiarch)
  [[ -e $root/usr/lib/$machine/crt1.o ]] || { echo "error: $root has no libc6-dev for $machine; install it there" >&2; return 1; }
  rm -rf "$out"
  for folder in "usr/lib/$machine" "lib/$machine" lib64; do
    mkdir -p "$out/$folder"
    for file in "$root/$folder"/{*crt[1in].o,lib{c,m,mvec,pthread,dl,rt}.so*,libm-*.so,libc_nonshared.a,ld-linux*}; do
      if [[ -e $(resolved "$root" "$folder/$(basename "$file")") ]]; then
        cp "$(resolved "$root" "$folder/$(basename "$file")")" "$out/$folder/$(basename "$file")"
      fi
    done
  done
}

# sysroot_flags SYSROOT: for the compiler as a linker. Its own folders of libraries would come first.
# Before glibc 2.34 threads were a library of their own. The compiler's runtime is linked in here,
# and not by targets alone, because its shared form needs the newer C library, and CMake's first
# step is a program that proves that the compiler works.
sysroot_flags() {
  local libraries
  libraries=$1/usr/lib/$(c++ -print-multiarch)
  c++ -std=c++20 -O2 -fPIC -c scripts/release/older_glibc.cpp -o "$1/older_glibc.o"
  echo "--sysroot=$1 -B$libraries/ -L$libraries -static-libstdc++ -static-libgcc $1/older_glibc.o -Wl,--no-as-needed -lpthread -ldl -Wl,--as-needed"
}
