#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks that CI has no time for; they run before a release. All take some five hours on 2 cores.
#   scripts/check_more.sh [CHECK...]     only these; without names, all that `checks` lists below
# The last result of each check stands in docs/develop/checks.csv, with its date and commit. A check of a tree
# with changes is not written there.
set -euo pipefail
source "$(dirname "$0")/common.sh"

readonly checks=(minimal threads sanitizers fuzz clang tidy cccl programs faults)
readonly results=docs/develop/checks.csv

run_tests() { ctest --test-dir "build/$1" --output-on-failure --no-tests=error --progress -j"$(nproc)" "${@:2}"; }

# The program from packed headers alone, as on a GPU server without packages. It is compiled by
# clang++ and under ThreadSanitizer, which watches the pools of threads and photos and the server.
check_minimal() {
  install_clang
  scripts/pack_headers.sh
  build minimal_thread gemsplat thread_tests
  grep -q "^gs_glm_DIR_FOUND:PATH=$PWD/.deps/include$" build/minimal_thread/CMakeCache.txt || die "GLM is not from .deps"
  if ldd build/minimal_thread/bin/gemsplat | grep -E 'opencv|OpenImageIO|ceres|fmt|spdlog|zstd|xxhash|libz\.|webp'; then
    die "the minimal program needs the libraries above"
  fi
  build/minimal_thread/bin/gemsplat report --help >/dev/null
  ctest --preset minimal_thread --progress
}

# The same tests with every library, and the program's own. What libraries do among themselves is not
# watched (TSAN_OPTIONS in CMakePresets.json): the locks of OpenImageIO's table of words are inlined in it,
# and ThreadSanitizer, which sees the bytes alone, would report races of photos whose headers are read.
check_threads() {
  install_clang
  gs_configure_args=(-DCMAKE_CXX_COMPILER=clang++)
  build thread gemsplat thread_tests
  gs_configure_args=()
  ctest --preset thread --progress
  build/thread/bin/gemsplat selftest --device cpu
}

# All tests under AddressSanitizer and UndefinedBehaviorSanitizer.
check_sanitizers() {
  build debug all
  run_tests debug
}

# Each fuzz target reads the same 100,000 inputs, and corpus_test reads damaged ones, all under the
# sanitizers and compiled by clang++.
check_fuzz() {
  install_clang
  build fuzz fuzz_tests fuzz_targets
  build/fuzz/tests/fuzz_tests
  scripts/fuzz.sh --runs 100000
}

check_clang() {
  install_clang
  build clang all
  run_tests clang
}

check_tidy() { scripts/tidy.sh; }

# CUDA files against the versions of CUB in GS_CCCL_DIRS. Without nvcc nothing was checked.
check_cccl() {
  local status=0
  scripts/check_cccl.sh || status=$?
  if [[ $status -eq 77 ]]; then is_skipped=yes; else return "$status"; fi
}

# Every browser test, our files in the programs of others, and packages.
check_programs() {
  command -v chromium >/dev/null || apt_install chromium || die "chromium cannot be installed"
  gs_configure_args=(-DGS_MORE_TESTS=ON)
  rm -f build/default/.configured
  build default all
  gs_configure_args=()
  run_tests default -L 'browser|interop|release'
}

# 1,200 calls that fail one after the other, and 500 kills, of a program under AddressSanitizer.
check_faults() {
  build debug faults_tests
  local campaign=(--program build/debug/bin/gemsplat --library build/debug/tests/libfail_nth.so)
  tests/faults/inject.py "${campaign[@]}" --faults 1200 --json build/debug/faults.json
  tests/faults/kills.py "${campaign[@]}" --kills 500 --json build/debug/kills.json
}

# record CHECK SECONDS: its row in the table of results, instead of an older one.
record() {
  [[ -z $(git status --porcelain -- . ":!$results") ]] || { say "not written to $results, since the tree has changes"; return; }
  { head -n 1 "$results"
    { tail -n +2 "$results" | grep -v "^$1," || true
      printf '%s,passed,%s,%s,%d\n' "$1" "$(date -u +%F)" "$(git rev-parse --short=8 HEAD)" "$2"; } | sort; } >"$results.new"
  mv "$results.new" "$results"
}

for name in "$@"; do
  [[ " ${checks[*]} " == *" $name "* ]] || die "there is no check $name; there are: ${checks[*]}"
done
install_packages
for name in "${@:-${checks[@]}}"; do
  say "$name"
  begin=$SECONDS
  is_skipped=no
  "check_$name"
  if [[ $is_skipped == no ]]; then record "$name" $((SECONDS - begin)); fi
done
