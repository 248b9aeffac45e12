#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks that CI has no time for: threads under ThreadSanitizer, all tests under AddressSanitizer and
# UndefinedBehaviorSanitizer, all tests of a program that clang++ has compiled, and clang-tidy over
# the whole tree, calls that fail and kills (docs/develop/reliability.md), tests that have to notice
# when a mend is gone, each test that docs/develop/reliability.md and SECURITY.md name, and the
# lines that the tests reach. They take some five hours on 2 cores.
#   scripts/check_more.sh [CHECK...]      only these; without names, all of: threads sanitizers clang tidy
#                                         faults mends claims coverage
#   scripts/check_more.sh faults-asan                    the faults with a program under AddressSanitizer
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

# test_faults preset: 1,200 calls that fail one after the other, and 500 kills.
test_faults() {
  build "$1" faults_tests
  local campaign=(--program "build/$1/bin/gemsplat" --library "build/$1/tests/libfail_nth.so")
  tests/faults/inject.py "${campaign[@]}" --faults 1200 --json "build/$1/faults.json"
  tests/faults/kills.py "${campaign[@]}" --kills 500 --json "build/$1/kills.json"
}

test_mends() {
  build default all
  tests/faults/undo_mends.py --build build/default
}

test_claims() {
  build default all
  scripts/check_claims.py --build build/default --run
}

install_packages
for check in "${@:-threads sanitizers clang tidy faults mends claims coverage}"; do
  for name in $check; do
    say "$name"
    case $name in
      threads) test_threads_with_clang ;;
      sanitizers) test_with_sanitizers ;;
      clang) test_with_clang ;;
      tidy) scripts/tidy.sh ;;
      faults) test_faults default ;;
      faults-asan) test_faults debug ;;
      mends) test_mends ;;
      claims) test_claims ;;
      coverage) scripts/coverage.sh ;;
      *) die "there is no check $name; there are threads, sanitizers, clang, tidy, faults, faults-asan, mends, claims and coverage" ;;
    esac
  done
done
