#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Compiles the CUDA files that use CUB against several versions of its headers (CCCL). Only nvcc's
# front end runs. Files that depend on the version are compiled a second time with functions that
# every version has (GS_FORCE_PORTABLE_CUB).
#   scripts/check_cccl.sh             checks the headers of nvcc's own toolkit
#   GS_CCCL_DIRS=DIR:DIR... scripts/check_cccl.sh
#                                     checks those of each DIR, too: a checkout of NVIDIA/cccl
# Takes some 15 s for each version on 2 cores. No GPU is needed.
set -euo pipefail
source "$(dirname "$0")/common.sh"

# The versions of CUDA 12.4 to 13.4. CUDA 12.0 to 12.3 have 2.0 to 2.2, whose functions 2.3 has,
# too.
wanted=(2.3 2.4 2.5 2.6 2.7 2.8 3.0 3.1 3.2 3.3 3.4)

nvcc=${CUDACXX:-$(command -v nvcc || echo /usr/local/cuda/bin/nvcc)}
if ! command -v "$nvcc" >/dev/null; then
  skip "nvcc was not found; put it on the PATH or name it with CUDACXX=FILE"
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

flags=(-std=c++20 -arch=compute_90 -ptx --expt-relaxed-constexpr "-diag-suppress=20012,554" -I. -I.deps/include)
if [[ $("$nvcc" --help) == *--fdevice-syntax-only* ]]; then flags+=(-fdevice-syntax-only); fi

# include_flags DIR: one a line, for a checkout of CCCL or a folder with cub/ and thrust/, as in
# toolkits.
include_flags() {
  if [[ -e $1/cub/cub/version.cuh ]]; then
    printf -- '-I%s\n' "$1/cub" "$1/thrust" "$1/libcudacxx/include"
  elif [[ -e $1/cub/version.cuh ]]; then
    printf -- '-I%s\n' "$1"
  else
    die "GS_CCCL_DIRS: there is neither cub/cub/version.cuh nor cub/version.cuh in $1; name a checkout of CCCL"
  fi
}

# cub_version FLAG...: such as 3.0.1, of the headers that nvcc finds with these flags.
cub_version() {
  local number
  printf '#include <cub/version.cuh>\nCUB_VERSION\n' >"$work/version.cu"
  number=$("$nvcc" -E "$@" "$work/version.cu" | tail -n 1)
  [[ $number =~ ^[0-9]+$ ]] || die "nvcc does not find cub/version.cuh ($*)"
  echo "$((number / 100000)).$((number / 100 % 1000)).$((number % 100))"
}

# check NAME FILE FLAG...: compiles one file; prints its errors where it fails.
check() {
  local name=$1 file=$2 log
  shift 2
  log=$(mktemp -p "$work")
  if "$nvcc" "$@" "$file" -o "$log.ptx" >"$log" 2>&1; then return; fi
  printf 'FAILED: %s with %s\n' "$file" "$name"
  grep -m 5 error "$log" || tail -n 5 "$log"
  touch "$work/failed"
}

# True for a file that chooses by the version of CUB, itself or through radix_sort.cuh.
chooses() { grep -qE 'GS_FORCE_PORTABLE_CUB|"cuda/render/radix_sort\.cuh"' "$1"; }

# run_limited COMMAND...: in the background, as soon as fewer than nproc are running.
run_limited() {
  while (($(jobs -rp | wc -l) >= $(nproc))); do wait -n; done
  "$@" &
}

mapfile -t files < <(grep -lE '#include (<cub/|"cuda/(device/cub_scratch|render/radix_sort)\.cuh")' cuda/*.cu cuda/*/*.cu)
IFS=: read -r -a folders <<<"${GS_CCCL_DIRS:-}"
found=()
for folder in '' "${folders[@]}"; do
  includes=()
  if [[ -n $folder ]]; then mapfile -t includes < <(include_flags "$folder"); fi
  version=$(cub_version "${includes[@]}")
  found+=("${version%.*}")
  say "CUB $version, ${folder:-of $nvcc}: ${files[*]}"
  for file in "${files[@]}"; do
    run_limited check "CUB $version" "$file" "${includes[@]}" "${flags[@]}"
    chooses "$file" || continue
    run_limited check "CUB $version and GS_FORCE_PORTABLE_CUB" "$file" "${includes[@]}" "${flags[@]}" -DGS_FORCE_PORTABLE_CUB
  done
done
wait
[[ ! -e $work/failed ]] || die "the files above do not compile with these versions of CUB"

unchecked=$(comm -23 <(printf '%s\n' "${wanted[@]}" | sort -u) <(printf '%s\n' "${found[@]}" | sort -u) | tr '\n' ' ')
say "All passed${unchecked:+; not checked, since GS_CCCL_DIRS has no headers of CUB $unchecked}"
