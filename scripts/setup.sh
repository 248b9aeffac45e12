#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing (Debian and Ubuntu) and builds into build/default all that `cmake --install` copies: the program,
# the C++ libraries and the Python module.
#   scripts/setup.sh [--packages-only] [--cuda VERSION]
#     --packages-only   only installs what is missing
#     --cuda VERSION    also installs that CUDA compiler, such as 12.9, from NVIDIA's apt repository
set -euo pipefail

usage() { sed -n '5,7s/^# //p' "$0"; }
wrong_usage() { echo "error: $*" >&2; usage >&2; exit 2; }

packages_only=no
cuda=
while [[ $# -gt 0 ]]; do
  case $1 in
    --packages-only) packages_only=yes; shift ;;
    --cuda)
      [[ ${2:-} =~ ^[0-9]+\.[0-9]+$ ]] || wrong_usage "--cuda takes a version such as 12.9, not '${2:-}'"
      cuda=$2
      shift 2 ;;
    -h | --help) usage; exit ;;
    *) wrong_usage "there is no flag $1" ;;
  esac
done
source "$(dirname "$0")/common.sh"

# install_cuda VERSION: the compiler, the static runtime and CUB, without a driver.
install_cuda() {
  local suffix=${1/./-}
  apt_install "cuda-nvcc-$suffix" "cuda-cudart-dev-$suffix" || die "CUDA $1 cannot be installed: add NVIDIA's apt repository first
       (its package cuda-keyring; NVIDIA's installation guide for Linux says how), and run this again"
}

install_packages
if [[ -n $cuda ]]; then install_cuda "$cuda"; fi
if [[ $packages_only == yes ]]; then exit; fi
build default installed
say "Ready: build/default/bin/gemsplat --help"
if compgen -G 'build/default/python/gemsplat/_gemsplat*.so' >/dev/null; then
  python=$(sed -n 's/^_Python3_EXECUTABLE:INTERNAL=//p' build/default/CMakeCache.txt)
  say "For Python: export PYTHONPATH=$PWD/build/default/python; the module is built for ${python:-python3}"
fi
say "To install it: cmake --install build/default --prefix FOLDER"
