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
gs_header_library(gs_fmt fmt/format.h)
gs_header_library(gs_spdlog spdlog/spdlog.h)
gs_header_library(gs_xxhash xxhash.h)
target_link_libraries(gs_spdlog INTERFACE gs_fmt)
target_compile_definitions(gs_spdlog INTERFACE SPDLOG_FMT_EXTERNAL FMT_HEADER_ONLY)
find_package(Threads REQUIRED)

# gs_report(name found purpose): remembers a line for the summary.
function(gs_report name found purpose)
  if(found)
    set(line "${name}: yes")
  else()
    set(line "${name}: MISSING, without it: ${purpose}")
  endif()
  set_property(GLOBAL APPEND_STRING PROPERTY GS_SUMMARY "  ${line}\n")
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
  find_package(OpenCV QUIET COMPONENTS core imgproc calib3d OPTIONAL_COMPONENTS videoio)
endif()
set(GS_HAVE_OPENCV ${OpenCV_FOUND})
gs_report("OpenCV" "${GS_HAVE_OPENCV}" "only undistorted photos (PINHOLE, SIMPLE_PINHOLE) can be trained, and no frames taken out of videos")

if(GS_WITH_ZSTD)
  find_library(GS_ZSTD_LIBRARY zstd)
  find_path(GS_ZSTD_DIR zstd.h)
  find_library(GS_XXHASH_LIBRARY xxhash)
  find_path(GS_XXHASH_DIR xxhash.h)
endif()
set(GS_HAVE_PHOTO_CACHE FALSE)
if(GS_ZSTD_LIBRARY AND GS_ZSTD_DIR AND GS_XXHASH_LIBRARY AND GS_XXHASH_DIR)
  set(GS_HAVE_PHOTO_CACHE TRUE)
endif()
gs_report("zstd and xxhash" "${GS_HAVE_PHOTO_CACHE}" "undistorted and resized photos are made anew in every run")

set(GS_HAVE_ZSTD FALSE)
if(GS_ZSTD_LIBRARY AND GS_ZSTD_DIR)
  set(GS_HAVE_ZSTD TRUE)
endif()
gs_report("zstd" "${GS_HAVE_ZSTD}" "no .spz of version 4 is read or written")

if(GS_WITH_ZLIB)
  find_package(ZLIB QUIET)
endif()
set(GS_HAVE_ZLIB ${ZLIB_FOUND})
gs_report("zlib" "${GS_HAVE_ZLIB}" "no .spz of versions 2 and 3 is read or written")

if(GS_WITH_WEBP)
  find_library(GS_WEBP_LIBRARY webp)
  find_path(GS_WEBP_DIR webp/encode.h)
endif()
set(GS_HAVE_WEBP FALSE)
if(GS_WEBP_LIBRARY AND GS_WEBP_DIR)
  set(GS_HAVE_WEBP TRUE)
endif()
gs_report("libwebp" "${GS_HAVE_WEBP}" "no .sog is read or written")

if(GS_WITH_CERES)
  find_package(Ceres QUIET)
endif()
set(GS_HAVE_CERES ${Ceres_FOUND})
gs_report("Ceres" "${GS_HAVE_CERES}" "no cameras are refined (--refine-cameras) and no exposures solved for (--exposure), and the gradient tests against ceres::Jet are left out")

include(web)

set(GS_HAVE_CUDA FALSE)
if(GS_WITH_CUDA)
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    set(CMAKE_CUDA_ARCHITECTURES ${GS_CUDA_ARCHITECTURES})
    enable_language(CUDA)
    if(NOT CMAKE_CUDA20_STANDARD_COMPILE_OPTION)  # CMake 3.25 does not know that nvcc 12 and later take C++20
      set(CMAKE_CUDA20_STANDARD_COMPILE_OPTION -std=c++20)
      set(CMAKE_CUDA20_EXTENSION_COMPILE_OPTION -std=c++20)
    endif()
    find_package(CUDAToolkit REQUIRED)
    if(EXISTS ${PROJECT_SOURCE_DIR}/cuda/CMakeLists.txt)
      set(GS_HAVE_CUDA TRUE)
    endif()
  endif()
endif()
if(GS_REQUIRE_CUDA AND NOT GS_HAVE_CUDA)
  message(FATAL_ERROR "GS_REQUIRE_CUDA is on, and nvcc (or the folder cuda/) was not found. Put nvcc on the PATH, or name "
                      "it with -DCMAKE_CUDA_COMPILER=FILE; the preset `default` builds for the CPU without it.")
endif()
gs_report("CUDA" "${GS_HAVE_CUDA}" "training and rendering run on the CPU")

# GoogleTest: installed, or as the sources that scripts/pack_headers.sh put beside the headers.
set(GS_HAVE_GTEST FALSE)
if(GS_BUILD_TESTS)
  cmake_path(GET GS_DEPS_INCLUDE PARENT_PATH gs_deps)
  find_package(GTest QUIET)
  if(NOT GTest_FOUND AND EXISTS ${gs_deps}/googletest/CMakeLists.txt)
    set(INSTALL_GTEST OFF CACHE INTERNAL "")
    add_subdirectory(${gs_deps}/googletest ${PROJECT_BINARY_DIR}/googletest EXCLUDE_FROM_ALL SYSTEM)
  endif()
  if(TARGET GTest::gmock_main)
    set(GS_HAVE_GTEST TRUE)
  endif()
  gs_report("GoogleTest" "${GS_HAVE_GTEST}" "no test is built")
endif()

# gs_leave_out(test library): a test that cannot be built here, for the summary.
function(gs_leave_out test library)
  set_property(GLOBAL APPEND_STRING PROPERTY GS_SUMMARY "  tests/${test}: left out, needs ${library}\n")
endfunction()

set(GS_BUILT_WITH_CUDA ${GS_HAVE_CUDA} CACHE INTERNAL "")  # read by scripts/demo.sh

# A NOTICE, so that `--log-level=NOTICE` prints this and no more.
function(gs_print_summary)
  get_property(summary GLOBAL PROPERTY GS_SUMMARY)
  message(NOTICE "gemsplat ${PROJECT_VERSION}, ${CMAKE_BUILD_TYPE}:\n${summary}")
endfunction()
