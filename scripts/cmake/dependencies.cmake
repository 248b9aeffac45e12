# SPDX-License-Identifier: Apache-2.0
# Finds what gemsplat can use. GLM, toml++, CLI11, spdlog and nlohmann-json are required (headers only);
# everything else is optional, and its absence is named in the summary and by the program at run time.

# gs_header_library(target header): an interface target for headers in GS_DEPS_INCLUDE or on the system.
function(gs_header_library target header)
  find_path(${target}_DIR_FOUND ${header} HINTS ${GS_DEPS_INCLUDE})
  if(NOT ${target}_DIR_FOUND)
    message(FATAL_ERROR "${header} was not found. Run scripts/setup.sh, or give the folder of the "
                        "header-only dependencies with -DGS_DEPS_INCLUDE=DIR (docs/developing.md).")
  endif()
  add_library(${target} INTERFACE)
  target_include_directories(${target} SYSTEM INTERFACE ${${target}_DIR_FOUND})
endfunction()

gs_header_library(gs_glm glm/vec3.hpp)
gs_header_library(gs_toml toml++/toml.h)
gs_header_library(gs_cli11 CLI/CLI.hpp)
gs_header_library(gs_json nlohmann/json.hpp)
gs_header_library(gs_spdlog spdlog/spdlog.h)
target_compile_definitions(gs_spdlog INTERFACE SPDLOG_FMT_EXTERNAL FMT_HEADER_ONLY)
find_package(OpenMP REQUIRED COMPONENTS CXX)

set(GS_FOUND "" CACHE INTERNAL "")
# gs_report(name found purpose): remembers a line for the summary.
function(gs_report name found purpose)
  if(found)
    set(line "  ${name}: yes")
  else()
    set(line "  ${name}: MISSING, without it: ${purpose}")
  endif()
  set(GS_FOUND "${GS_FOUND}${line}\n" CACHE INTERNAL "")
endfunction()

if(GS_WITH_OPENIMAGEIO)
  find_package(OpenImageIO QUIET)
endif()
set(GS_HAVE_OPENIMAGEIO ${OpenImageIO_FOUND})
gs_report("OpenImageIO" "${GS_HAVE_OPENIMAGEIO}" "photos are read as JPEG or PNG only, through stb_image")
if(NOT GS_HAVE_OPENIMAGEIO)
  find_path(GS_STB_DIR stb_image.h HINTS ${GS_DEPS_INCLUDE} PATH_SUFFIXES stb REQUIRED)
endif()

if(GS_WITH_OPENCV)
  find_package(OpenCV QUIET COMPONENTS core imgproc calib3d)
endif()
set(GS_HAVE_OPENCV ${OpenCV_FOUND})
gs_report("OpenCV" "${GS_HAVE_OPENCV}" "only undistorted photos (PINHOLE, SIMPLE_PINHOLE) can be trained")

if(GS_WITH_CERES)
  find_package(Ceres QUIET)
endif()
set(GS_HAVE_CERES ${Ceres_FOUND})
gs_report("Ceres" "${GS_HAVE_CERES}" "the gradient tests against ceres::Jet are left out")

set(GS_HAVE_CUDA FALSE)
if(GS_WITH_CUDA)
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    set(CMAKE_CUDA_ARCHITECTURES ${GS_CUDA_ARCHITECTURES})
    enable_language(CUDA)
    find_package(CUDAToolkit REQUIRED)
    if(EXISTS ${PROJECT_SOURCE_DIR}/cuda/CMakeLists.txt)
      set(GS_HAVE_CUDA TRUE)
    endif()
  endif()
endif()
gs_report("CUDA" "${GS_HAVE_CUDA}" "training and rendering run on the CPU")

function(gs_print_summary)
  message(STATUS "gemsplat ${PROJECT_VERSION}, ${CMAKE_BUILD_TYPE}:\n${GS_FOUND}")
endfunction()
