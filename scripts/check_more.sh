#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks that CI leaves out for time: ThreadSanitizer over the pools and the viewer's server, and
# clang++ as a second compiler for the CPU half. They take some 20 minutes on 2 cores.
set -euo pipefail
source "$(dirname "$0")/common.sh"

# The thread pool, the photo pool and the viewer's server under ThreadSanitizer.
test_threads() {
  build thread thread_tests
  ctest --preset thread --progress -j"$(nproc)"
}

# A second compiler for the CPU half. Its program checks itself; its speed does not matter.
build_with_clang() {
  command -v clang++ >/dev/null || apt_install clang || { echo "skipped: clang cannot be installed"; return; }
  gs_configure_args=(-DGS_BUILD_TESTS=OFF -DGS_WITH_PYTHON=OFF -DCMAKE_CXX_FLAGS_RELEASE=-O1)
  build clang gemsplat
  gs_configure_args=()
  build/clang/bin/gemsplat selftest --device cpu
}

install_packages
say "Threads under ThreadSanitizer"
test_threads
say "clang++"
build_with_clang
