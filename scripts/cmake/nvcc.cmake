# SPDX-License-Identifier: Apache-2.0
# Decides whether the nvcc at hand can compile gemsplat, and for which GPUs. The file has only
# functions, so that tests/cmake/nvcc_test.cmake can call them with a fake nvcc.
set(GS_OLDEST_CUDA 12.0)  # the first nvcc that takes C++20

# GPUs of the portable build: compute capability 7.5 (Turing), 8.0 and 8.6 (Ampere), 8.9 (Ada), 9.0
# (Hopper), and 10.0 and 12.0 (Blackwell).
set(GS_PORTABLE_CAPABILITIES 75 80 86 89 90 100 120)

# For a machine without a GPU, since the program will run elsewhere. 80-virtual is PTX: the driver
# compiles it at the first start on a card of compute capability 8.x. 90 is code for 9.0, with PTX
# for later cards. Each entry costs compile time.
set(GS_ARCHITECTURES_WITHOUT_GPU "80-virtual;90")

# gs_nvcc_version(result nvcc): such as 12.4; empty where the compiler is another one.
function(gs_nvcc_version result nvcc)
  execute_process(COMMAND ${nvcc} --version OUTPUT_VARIABLE text ERROR_QUIET)
  string(REGEX MATCH "release ([0-9]+\\.[0-9]+)" found "${text}")
  set(${result} "${CMAKE_MATCH_1}" PARENT_SCOPE)
endfunction()

# gs_refuse_old_nvcc(nvcc): stops if nvcc does not know C++20.
function(gs_refuse_old_nvcc nvcc)
  gs_nvcc_version(version ${nvcc})
  if(version AND version VERSION_LESS GS_OLDEST_CUDA)
    message(FATAL_ERROR "${nvcc} is CUDA ${version}, and gemsplat needs CUDA ${GS_OLDEST_CUDA} or later. Install a newer CUDA "
                        "toolkit and name its compiler with -DCMAKE_CUDA_COMPILER=FILE, or build for the CPU alone with "
                        "-DGS_WITH_CUDA=OFF; in both cases add --fresh, since CMake remembers the compiler.")
  endif()
endfunction()

# gs_portable_architectures(result nvcc): code for each of GS_PORTABLE_CAPABILITIES that nvcc can
# compile for, such as 75-real;...;90-real;120. The last one also brings PTX, for cards that come
# later.
function(gs_portable_architectures result nvcc)
  execute_process(COMMAND ${nvcc} --list-gpu-arch OUTPUT_VARIABLE text ERROR_QUIET)
  set(list)
  foreach(capability IN LISTS GS_PORTABLE_CAPABILITIES)
    if(text MATCHES "compute_${capability}(\n|$)")
      list(APPEND list ${capability}-real)
    endif()
  endforeach()
  list(POP_BACK list newest)
  string(REPLACE "-real" "" newest "${newest}")
  list(APPEND list ${newest})
  set(${result} "${list}" PARENT_SCOPE)
endfunction()

# gs_compress_option(result nvcc): the flag that makes device code smallest. CUDA 12.8 brought the
# first one; its programs need a driver from 550.54 on (CUDA 12.4).
function(gs_compress_option result nvcc)
  gs_nvcc_version(version ${nvcc})
  if(version VERSION_LESS 12.8)
    set(${result} -Xfatbin=-compress-all PARENT_SCOPE)
  else()
    set(${result} --compress-mode=size PARENT_SCOPE)
  endif()
endfunction()

# gs_default_architectures(result): CUDAARCHS of the environment (a variable of CMake); else the GPU
# of this machine; else GS_ARCHITECTURES_WITHOUT_GPU.
function(gs_default_architectures result)
  execute_process(COMMAND nvidia-smi -L RESULT_VARIABLE no_gpu OUTPUT_QUIET ERROR_QUIET)
  if(NOT "$ENV{CUDAARCHS}" STREQUAL "")
    set(${result} "$ENV{CUDAARCHS}" PARENT_SCOPE)
  elseif(no_gpu STREQUAL "0")
    set(${result} native PARENT_SCOPE)
  else()
    set(${result} "${GS_ARCHITECTURES_WITHOUT_GPU}" PARENT_SCOPE)
  endif()
endfunction()

# gs_name_architectures(result architectures native): for people, such as "80-virtual, 90". `native`
# holds the architectures of the GPUs here, as CMake found them; it replaces the word native.
function(gs_name_architectures result architectures native)
  if(architectures STREQUAL "native" AND native)
    set(architectures "${native}")
  endif()
  string(REPLACE ";" ", " text "${architectures}")
  set(${result} "${text}" PARENT_SCOPE)
endfunction()

# gs_explain_architectures(result architectures): the text for the summary.
function(gs_explain_architectures result architectures)
  set(why "")
  if(architectures STREQUAL "native")
    set(why " (the GPU of this machine alone; the preset `portable` compiles for others, too)")
  elseif(architectures STREQUAL GS_ARCHITECTURES_WITHOUT_GPU)
    string(CONCAT why
      " (there is no GPU here: runs on compute capability 8.0 and later; for all but 9.0 the driver compiles at the first start; "
      "the preset `portable` compiles for 7.5 and later beforehand, and takes several times as long)")
  endif()
  set(${result} "${architectures}${why}" PARENT_SCOPE)
endfunction()
