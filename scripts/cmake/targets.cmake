# SPDX-License-Identifier: Apache-2.0
# gs_library(), gs_test() and gs_benchmark(): one line per target elsewhere.

# Warnings, sanitizers and the arithmetic that all our own targets share.
add_library(gs_flags INTERFACE)
target_include_directories(gs_flags INTERFACE ${PROJECT_SOURCE_DIR})
set(gs_cxx "$<$<COMPILE_LANGUAGE:CXX>:")
# A product and a sum are one rounding only where multiply_add() says so: forward and backward, and two
# compilers, then agree on every bit.
target_compile_options(gs_flags INTERFACE "${gs_cxx}-Wall;-Wextra;-ffp-contract=off;-fno-math-errno>")
if(GS_NATIVE)
  target_compile_options(gs_flags INTERFACE "${gs_cxx}-march=native>")
endif()
if(GS_SANITIZE)
  target_compile_options(gs_flags INTERFACE "${gs_cxx}-fsanitize=address,undefined;-fno-omit-frame-pointer;-fno-sanitize-recover=undefined>")
  target_link_options(gs_flags INTERFACE -fsanitize=address,undefined)
endif()

# gs_library(name SOURCES ... PUBLIC ... PRIVATE ...)
function(gs_library name)
  cmake_parse_arguments(arg "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${arg_SOURCES})
  target_link_libraries(${name} PUBLIC gs_flags ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
endfunction()

# gs_test(path [LINK ...] [LABELS ...]): tests/<path>.cpp, with everything linked.
function(gs_test path)
  cmake_parse_arguments(arg "" "" "LINK;LABELS" ${ARGN})
  string(REPLACE "/" "_" name ${path})
  add_executable(${name} ${path}.cpp)
  target_link_libraries(${name} PRIVATE gs_test_support ${arg_LINK})
  gtest_discover_tests(${name} TEST_PREFIX "${path}." PROPERTIES LABELS "${arg_LABELS}" TIMEOUT 600
                       DISCOVERY_MODE PRE_TEST WORKING_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
endfunction()

# gs_benchmark(path): tests/<path>.cpp with Google Benchmark.
function(gs_benchmark path)
  string(REPLACE "/" "_" name ${path})
  add_executable(${name} ${path}.cpp)
  target_link_libraries(${name} PRIVATE gs_test_support benchmark::benchmark_main)
endfunction()
