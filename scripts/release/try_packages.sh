#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the packages of a release in fresh systems, and uses them as people would:
#   scripts/release/try_packages.sh PACKAGES BASE [deb] [python] [dev] [tar]
#     PACKAGES  the folder that scripts/release.sh wrote
#     BASE      a fresh system, such as `debootstrap --variant=minbase bookworm BASE` makes it; it is copied for
#               each test, and not changed
#     deb       gemsplat: trains the bundled scene for 40 steps as the user nobody, without a compiler; removing leaves nothing
#     python    python3-gemsplat: imports, loads the scene, trains 10 steps
#     dev       libgemsplat-dev: compiles the installed example and runs it
#     tar       the archive, unpacked into a folder: trains the bundled scene
# Without a name it tries all but tar. Needs root, since it changes into the systems (chroot), and the network
# for the packages that ours depend on.
set -euo pipefail

usage() { sed -n '4,12s/^# //p' "$0"; }
die() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
say() { printf '== %s\n' "$*"; }

[[ $# -ge 2 ]] || { usage >&2; exit 2; }
packages=$(realpath "$1")
base=$(realpath "$2")
shift 2
tests=("$@")
[[ ${#tests[@]} -gt 0 ]] || tests=(deb python dev)
[[ $(id -u) -eq 0 ]] || die "this needs root"
[[ -x $base/usr/bin/apt-get ]] || die "$base has no apt-get; make it with debootstrap --variant=minbase SUITE $base"
work=$(mktemp -d "$(dirname "$base")/try.XXXXXX")
trap 'rm -rf --one-file-system "$work"' EXIT

# shellcheck disable=SC2016  # the inner shell expands these
# inside COMMAND...: as root in the copy, with a /proc of its own that goes with the command.
inside() {
  unshare --mount --pid --fork bash -c 'mount -t proc proc "$0/proc" && mount --bind /dev "$0/dev" &&
    exec chroot "$0" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"' "$work/system" "$@"
}

as_nobody() { inside setpriv --reuid=65534 --regid=65534 --clear-groups env HOME=/tmp sh -ec "cd /tmp; $1"; }

# install PACKAGE...: with apt-get, in a new copy of BASE; shows its output only when it fails.
install() {
  say "A fresh system: $*"
  rm -rf --one-file-system "$work/system"
  cp -a "$base" "$work/system"
  cp /etc/resolv.conf "$work/system/etc/resolv.conf"
  mkdir "$work/system/packages"
  cp "$packages"/* "$work/system/packages/"
  inside find / -xdev -path /proc -prune -o -name '*gemsplat*' -print | grep -v '^/packages/' >"$work/before" || true
  if [[ $# -gt 0 ]]; then
    { inside apt-get update && inside sh -c "cd /packages; apt-get install -y --no-install-recommends $*"; } >"$work/apt.log" 2>&1 ||
      die "apt-get install $*: $(tail -n 20 "$work/apt.log")"
  fi
}

no_compiler() {
  if inside sh -c 'command -v cc || command -v c++ || command -v gcc || command -v ninja'; then die "there is a compiler"; fi
}

# remove PACKAGE...: nothing with our name is left.
remove() {
  inside apt-get purge -y "$@" >"$work/apt.log" 2>&1 || die "apt-get purge $*: $(tail -n 20 "$work/apt.log")"
  rm -rf "$work/system/packages" "$work/system"/tmp/*
  inside find / -xdev -path /proc -prune -o \( -name '*gemsplat*' -o -name 'libgs_*' \) -print >"$work/after"
  cmp -s "$work/before" "$work/after" || die "removing leaves $(cat "$work/after")"
}

# trained RUN: the run has what README.md says.
trained() {
  local run=$work/system/tmp/$1 file
  for file in results.json report.html comparison.png point_cloud; do [[ -e $run/$file ]] || die "the run has no $file"; done
  sed -n 's/^ *"psnr": \([0-9.]*\).*/   PSNR of held-out photos: \1 dB/p' "$run/results.json" | head -n 1
}

try_deb() {
  install './gemsplat_*.deb'
  no_compiler
  as_nobody 'gemsplat --version; gemsplat info | grep "^  CUDA"; gemsplat train /usr/share/gemsplat/courtyard -o demo -c cpu_tiny --eval --iterations 40 >train.log 2>&1 || { tail train.log; exit 1; }'
  trained demo
  if as_nobody 'gemsplat train /usr/share/gemsplat/nowhere -o other 2>error'; then die "a scene that is not there is no error"; fi
  grep -q nowhere "$work/system/tmp/error" || die "the error is $(cat "$work/system/tmp/error")"
  remove gemsplat
}

try_python() {
  local code
  install './python3-gemsplat_*.deb' './gemsplat_*.deb'
  no_compiler
  code='import gemsplat, sys
scene = gemsplat.Scene.load("/usr/share/gemsplat/courtyard", eval=True, resolution=8)
result = gemsplat.train(scene, iterations=10)
print("  ", gemsplat.__file__, len(scene.train_views), "photos,", result.steps, "steps:", result.model)
sys.exit(result.steps != 10)'
  as_nobody "python3 -c '$code' 2>error || { cat error; exit 1; }"
  inside python3 -c 'import gemsplat'  # root's Python may write beside the module
  remove python3-gemsplat gemsplat
}

try_dev() {
  install './libgemsplat-dev_*.deb' './gemsplat_*.deb' g++ cmake make
  as_nobody 'cmake -S /usr/share/gemsplat/example -B build -DCMAKE_BUILD_TYPE=Release >log 2>&1 && cmake --build build >>log 2>&1 || { grep -v "^$" log | tail -n 60; exit 1; }
    build/gemsplat_example /usr/share/gemsplat/courtyard 20 out 2>error || { cat error; exit 1; }; gemsplat info out/model.spz | head -n 3'
  remove libgemsplat-dev gemsplat
}

try_tar() {
  install
  tar -xf "$packages"/gemsplat-*-linux-*.tar.gz -C "$work/system/tmp"
  as_nobody 'gemsplat-*/bin/gemsplat --version
    gemsplat-*/bin/gemsplat train gemsplat-*/share/gemsplat/courtyard -o demo -c cpu_tiny --eval --iterations 40 >train.log 2>&1 || { tail train.log; exit 1; }'
  trained demo
}

for name in "${tests[@]}"; do
  case $name in
    deb | python | dev | tar) "try_$name" ;;
    *) usage >&2; die "there is no test $name" ;;
  esac
done
say "All passed: ${tests[*]}"
