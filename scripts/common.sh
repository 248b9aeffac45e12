# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# What setup.sh, demo.sh, test.sh and .ci/run share; sourced by them. Changes to the root of the repository.
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit

# Debian's and Ubuntu's names. Each library but the headers is optional to the build (scripts/cmake).
GS_PACKAGES=(
  cmake ninja-build g++ git                                                       # build tools
  libglm-dev libtomlplusplus-dev libcli11-dev libspdlog-dev libfmt-dev nlohmann-json3-dev libstb-dev  # headers
  libopenimageio-dev openimageio-tools libopenexr-dev libimath-dev                # photos
  libopencv-dev libceres-dev                                                      # lenses, cameras
  libzstd-dev libxxhash-dev                                                       # decoded photos on disk; .spz 4
  zlib1g-dev libwebp-dev                                                          # .spz, .sog
  libpugixml-dev                                                                  # cameras of Metashape
  pybind11-dev python3-dev python3-numpy                                          # the Python module
  libgtest-dev libgmock-dev libbenchmark-dev                                      # tests
)
# Report pages. Debian's packages conflict with node from elsewhere, so only where there is none.
command -v npm >/dev/null || GS_PACKAGES+=(nodejs npm)
readonly GS_PACKAGES
gs_configure_args=()

say() { printf '== %s\n' "$*"; }
die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# The packages of GS_PACKAGES that dpkg does not know as installed, one a line.
missing_packages() {
  comm -23 <(printf '%s\n' "${GS_PACKAGES[@]}" | sort) \
           <(dpkg-query -W -f='${db:Status-Status} ${Package}\n' "${GS_PACKAGES[@]}" 2>/dev/null |
             sed -n 's/^installed //p' | sort)
}

# apt_install PACKAGE...: one quiet apt-get; shows its output only when it fails.
apt_install() {
  local as_root=() log
  if [[ $(id -u) -ne 0 ]]; then
    command -v sudo >/dev/null || return 1
    as_root=(sudo)
  fi
  log=$(mktemp)
  if "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive bash -c \
      'apt-get update && apt-get install -y --no-install-recommends "$@"' apt "$@" >"$log" 2>&1; then
    rm -f "$log"
  else
    tail -n 20 "$log" >&2
    rm -f "$log"
    return 1
  fi
}

# The second compiler, with the runtimes of its sanitizers and of libFuzzer.
install_clang() {
  command -v clang++ >/dev/null || apt_install clang libclang-rt-14-dev || die "clang cannot be installed"
}

# Can the compiler see the headers that the build cannot do without? `have_headers -I DIR` looks there too.
have_headers() {
  local header
  for header in glm/vec3.hpp toml++/toml.h CLI/CLI.hpp fmt/format.h spdlog/spdlog.h nlohmann/json.hpp; do
    printf '#if !__has_include(<%s>)\n#error\n#endif\n' "$header"
  done | c++ -std=c++20 -E -x c++ "$@" - >/dev/null 2>&1
}

# use_what_is_there PACKAGE...: for when these cannot be installed from here. Goes on where the tools and headers
# are there all the same, else stops.
use_what_is_there() {
  local tool
  printf 'This script cannot install what gemsplat uses here; please do so (Debian names):\n  %s\n' "$*" >&2
  for tool in cmake ninja c++; do
    command -v "$tool" >/dev/null || die "$tool was not found; install it and run this again"
  done
  if have_headers; then
    say "Going on with the headers of this machine; libraries that are missing are left out"
  elif have_headers -I .deps/include; then
    say "Going on with the headers in .deps/include; libraries that are missing are left out"
    gs_configure_args=(-DGS_DEPS_INCLUDE="$PWD/.deps/include")
  else
    die "GLM, toml++, CLI11, spdlog, fmt or nlohmann-json was not found; install them, or run
       scripts/pack_headers.sh on a machine that has them and bring its folder .deps here"
  fi
}

# Installs what is missing with one apt-get; does nothing when all is there.
install_packages() {
  local missing
  if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    use_what_is_there "${GS_PACKAGES[@]}"
    return
  fi
  mapfile -t missing < <(missing_packages)
  [[ ${#missing[@]} -gt 0 ]] || return 0
  say "Installing with apt-get (about a minute, 2 GB at most): ${missing[*]}"
  if apt_install "${missing[@]}"; then
    rm -f build/*/.configured  # so that the next build finds them
  else
    use_what_is_there "${missing[@]}"
  fi
}

# show_progress: passes ninja's output on, but shortens its status lines ("@@ DONE TOTAL ...") to one line every
# GS_PROGRESS_SECONDS: "   34% of the build: 210 of 611 steps, 3 min". Errors and warnings pass unchanged.
show_progress() {
  local line begin=$SECONDS next=$SECONDS
  while IFS= read -r line; do
    if [[ $line =~ ^@@\ ([0-9]+)\ ([0-9]+)\  ]]; then
      local finished=${BASH_REMATCH[1]} total=${BASH_REMATCH[2]}
      if ((SECONDS < next && finished < total)); then continue; fi
      next=$((SECONDS + ${GS_PROGRESS_SECONDS:-30}))
      printf '   %d%% of the build: %d of %d steps, %d min\n' \
        $((100 * finished / total)) "$finished" "$total" $(((SECONDS - begin + 30) / 60))
    else
      printf '%s\n' "$line"
    fi
  done
}

# build PRESET TARGET...: configures where that was not done yet, and builds; no work when up to date.
build() {
  local preset=$1
  shift
  if [[ ! build/$preset/.configured -nt CMakePresets.json ]]; then
    say "Configuring build/$preset (about a minute)"
    cmake --preset "$preset" --log-level=NOTICE "${gs_configure_args[@]}" >/dev/null
    touch "build/$preset/.configured"
  fi
  say "Building build/$preset: $*"
  local build=(cmake --build "build/$preset" -j "$(nproc)" --target "$@")
  if [[ -t 1 ]]; then
    "${build[@]}"
  else
    NINJA_STATUS='@@ %f %t ' "${build[@]}" | show_progress
  fi
}

skip() { printf 'skipped: %s\n' "$*"; exit 77; }  # as CTest is told

# find_chromium [PROGRAM]: prints that program, or the Chromium of this machine. Skips where there is none.
find_chromium() {
  local chromium=${1:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
  [[ -x $chromium ]] || skip "no Chromium was found; install the package chromium" >&2
  printf '%s\n' "$chromium"
}

# install_npm_packages SOURCE FOLDER: the packages of SOURCE/package-lock.json in FOLDER/node_modules. Skips where they
# cannot be had.
install_npm_packages() {
  local source=$1 folder=$2
  command -v node >/dev/null || skip "there is no node; install Node 20 or newer"
  command -v npm >/dev/null || skip "there is no npm"
  mkdir -p "$folder"
  cp "$source/package.json" "$source/package-lock.json" "$folder/"
  cmp -s "$source/package-lock.json" "$folder/node_modules/.lock-of-these" && return
  (cd "$folder" && npm ci --ignore-scripts --no-audit --no-fund >npm.log 2>&1) ||
    skip "npm cannot install the packages of $source ($(tail -1 "$folder/npm.log"))"
  cp "$source/package-lock.json" "$folder/node_modules/.lock-of-these"
}
