#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks that CI has no time for: all tests under AddressSanitizer and UndefinedBehaviorSanitizer,
# all tests of a program that clang++ has compiled, and clang-tidy over the whole tree. They take
# some two hours on 2 cores.
#   scripts/check_more.sh [sanitizers] [clang] [tidy]      only these; without names, all
set -euo pipefail
source "$(dirname "$0")/common.sh"

test_with_sanitizers() {
  build debug all
  ctest --test-dir build/debug --output-on-failure --no-tests=error --progress -j"$(nproc)"
}

test_with_clang() {
  command -v clang++ >/dev/null || apt_install clang || die "clang cannot be installed"
  build clang all
  ctest --test-dir build/clang --output-on-failure --no-tests=error --progress -j"$(nproc)"
}

install_packages
for check in "${@:-sanitizers clang tidy}"; do
  for name in $check; do
    say "$name"
    case $name in
      sanitizers) test_with_sanitizers ;;
      clang) test_with_clang ;;
      tidy) scripts/tidy.sh ;;
      *) die "there is no check $name; there are sanitizers, clang and tidy" ;;
    esac
  done
done
