# SPDX-License-Identifier: Apache-2.0
# Options: what to build, and for which machine.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_INSTALL_RPATH_USE_LINK_PATH ON)  # finds libraries outside of the system's folders
set(CMAKE_POSITION_INDEPENDENT_CODE ON)  # for the Python module and shared libraries
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

option(GS_WITH_OPENIMAGEIO "Read and write photos through OpenImageIO (else JPEG and PNG through stb)" ON)
option(GS_WITH_OPENCV "Undistort photos of lens models with OpenCV" ON)
option(GS_WITH_ZSTD "Keep undistorted and resized photos on disk, with zstd and xxhash" ON)
option(GS_WITH_ZLIB "Read and write .spz with zlib (version 4: with zstd)" ON)
option(GS_WITH_WEBP "Read and write .sog with libwebp" ON)
option(GS_WITH_CERES "Check every gradient against ceres::Jet; refine cameras" ON)
option(GS_WITH_CUDA "Build the CUDA backend where nvcc is found" ON)
option(GS_WITH_PYTHON "Build the Python module where pybind11 and NumPy are found" ON)
option(GS_WITH_WEB "Bundle the pages of reports and of the viewer where npm is found" ON)
option(GS_WITH_HTTPLIB "Serve the viewer with cpp-httplib" ON)
option(GS_REQUIRE_CUDA "Stop when nvcc is not found, instead of building for the CPU alone" OFF)
option(GS_NATIVE "Compile for the instruction set of this machine" ON)
option(GS_SANITIZE "Build with AddressSanitizer and UndefinedBehaviorSanitizer" OFF)
option(GS_BUILD_TESTS "Build the tests" ON)
option(GS_BUILD_BENCHMARKS "Build the benchmarks in tests/bench" ON)
set(GS_PYTHON "" CACHE FILEPATH "The Python interpreter to build the module for; the first with NumPy where empty")
set(GS_DEPS_INCLUDE "" CACHE PATH "Folder with the header-only dependencies, where no package has them")
# Empty: gs_default_architectures() of nvcc.cmake chooses. `portable`: gs_portable_architectures()
# makes the list.
set(GS_CUDA_ARCHITECTURES "" CACHE STRING "GPU architectures to compile for, as in CMAKE_CUDA_ARCHITECTURES, or `portable`")
