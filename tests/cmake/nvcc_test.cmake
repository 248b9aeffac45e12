# SPDX-License-Identifier: Apache-2.0
# cmake -DSCRIPTS=FOLDER -DWORK=FOLDER -P nvcc_test.cmake: scripts/cmake/nvcc.cmake refuses an nvcc
# without C++20 and knows which GPUs the others compile for. Each nvcc here is a shell script that
# only answers.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/expect.cmake)
include(${SCRIPTS}/nvcc.cmake)

# make_nvcc(version capabilities...): writes ${WORK}/nvcc-VERSION.
function(make_nvcc version)
  string(REPLACE ";" " compute_" architectures "compute_${ARGN}")
  file(WRITE ${WORK}/nvcc-${version} "#!/bin/sh
case $1 in
  --version) echo 'nvcc: NVIDIA (R) Cuda compiler driver'; echo 'Cuda compilation tools, release ${version}, V${version}.1' ;;
  --list-gpu-arch) printf '%s\\n' ${architectures} ;;
esac
")
  file(CHMOD ${WORK}/nvcc-${version} PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
endfunction()

# refusal_of(result version): what gs_refuse_old_nvcc() says to that nvcc; empty where it takes it.
function(refusal_of result version)
  file(WRITE ${WORK}/refuse.cmake "cmake_minimum_required(VERSION 3.25)\ninclude(${SCRIPTS}/nvcc.cmake)\ngs_refuse_old_nvcc(${WORK}/nvcc-${version})\n")
  execute_process(COMMAND ${CMAKE_COMMAND} -P ${WORK}/refuse.cmake RESULT_VARIABLE code ERROR_VARIABLE text)
  if(code STREQUAL "0")
    set(text "")
  endif()
  string(REGEX REPLACE "[ \n]+" " " text "${text}")  # CMake wraps its lines
  set(${result} "${text}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
make_nvcc(11.8 50 60 70 75 80 86 87 89 90)
make_nvcc(12.0 50 60 70 75 80 86 87 89 90)
make_nvcc(13.0 75 80 86 87 88 89 90 100 110 103 120 121)

refusal_of(refusal 11.8)
expect_in("The refusal of CUDA 11.8" "${refusal}" "is CUDA 11.8, and gemsplat needs CUDA 12.0 or later")
expect_in("The refusal of CUDA 11.8" "${refusal}" "-DGS_WITH_CUDA=OFF")
foreach(version 12.0 13.0)
  refusal_of(refusal ${version})
  expect_equal("The refusal of CUDA ${version}" "${refusal}" "")
endforeach()

gs_portable_architectures(list ${WORK}/nvcc-12.0)
expect_equal("The portable list of CUDA 12.0" "${list}" "75-real;80-real;86-real;89-real;90")
gs_portable_architectures(list ${WORK}/nvcc-13.0)
expect_equal("The portable list of CUDA 13.0" "${list}" "75-real;80-real;86-real;89-real;90-real;100-real;120")

set(ENV{CUDAARCHS} "86;89")
gs_default_architectures(list)
expect_equal("The default where CUDAARCHS is set" "${list}" "86;89")
set(ENV{CUDAARCHS} "")
set(ENV{PATH} ${WORK})  # no nvidia-smi
gs_default_architectures(list)
expect_equal("The default without a GPU" "${list}" "80-virtual;90")
gs_explain_architectures(line "${list}")
expect_in("The line of the summary" "${line}" "80-virtual;90 (there is no GPU here: runs on compute capability 8.0 and later")
file(WRITE ${WORK}/nvidia-smi "#!/bin/sh\n")
file(CHMOD ${WORK}/nvidia-smi PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
gs_default_architectures(list)
expect_equal("The default with a GPU" "${list}" "native")

gs_name_architectures(text "80-virtual;90" "")
expect_equal("Architectures of a list" "${text}" "80-virtual, 90")
gs_name_architectures(text native 86-real)
expect_equal("Architectures of the GPU here" "${text}" "86-real")
gs_name_architectures(text native "")
expect_equal("Architectures where CMake found no GPU" "${text}" "native")
