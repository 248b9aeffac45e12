#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks that CI has no time for: threads under ThreadSanitizer, all tests under AddressSanitizer and
# UndefinedBehaviorSanitizer, all tests of a program that clang++ has compiled, and clang-tidy over
# the whole tree. They take some two hours on 2 cores.
#   scripts/check_more.sh [threads] [sanitizers] [clang] [tidy]      only these; without names, all
set -euo pipefail
source "$(dirname "$0")/common.sh"

# The second compiler, clang++, makes the CPU half with every library, under ThreadSanitizer: the
# tests of the thread pool, the photo pool and the viewer's server, and the program, which they run.
test_threads_with_clang() {
  install_clang
  gs_configure_args=(-DCMAKE_CXX_COMPILER=clang++)
  build thread thread_tests
  gs_configure_args=()
  ctest --preset thread --progress -j"$(nproc)"
  build/thread/bin/gemsplat selftest --device cpu
}

test_with_sanitizers() {
  build debug all
  ctest --test-dir build/debug --output-on-failure --no-tests=error --progress -j"$(nproc)"
}

test_with_clang() {
  install_clang
  build clang all
  ctest --test-dir build/clang --output-on-failure --no-tests=error --progress -j"$(nproc)"
}

install_packages
for check in "${@:-threads sanitizers clang tidy}"; do
  for name in $check; do
    say "$name"
    case $name in
      threads) test_threads_with_clang ;;
      sanitizers) test_with_sanitizers ;;
      clang) test_with_clang ;;
      tidy) scripts/tidy.sh ;;
      *) die "there is no check $name; there are threads, sanitizers, clang and tidy" ;;
    esac
  done
done
