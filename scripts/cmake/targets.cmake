# SPDX-License-Identifier: Apache-2.0
# gs_library(), gs_test() and gs_benchmark() make a target in one call. install.cmake installs them.

# Warnings, sanitizers and the arithmetic that all our own targets share.
add_library(gs_flags INTERFACE)
target_include_directories(gs_flags INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<INSTALL_INTERFACE:${GS_INSTALL_INCLUDE_DIR}>)
target_compile_features(gs_flags INTERFACE cxx_std_20)
set(gs_cxx "$<$<COMPILE_LANGUAGE:CXX>:")
# Products and sums are fused only in multiply_add(), so that forward and backward pass, and two
# compilers, agree on every bit. Programs that link the installed libraries inherit the flags: the
# linker keeps one copy of an inline function, which may be theirs.
target_compile_options(gs_flags INTERFACE "${gs_cxx}-ffp-contract=off;-fno-math-errno>")
# The libraries are position independent, so that a shared library can contain them. The last flag
# lets calls within a file be inlined nevertheless.
target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:${gs_cxx}-Wall;-Wextra;-fno-semantic-interposition>>")
# GCC 12 warns of wrong copies in "text" + string, in its own header and wrongly (GCC bug 105651).
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:${gs_cxx}-Wno-restrict;-Wno-array-bounds;-Wno-stringop-overflow;-Wno-stringop-overread>>")
endif()
# g++ looks for memory to use again from 128 MiB on, which takes a tenth of its time. Beginning at so many KiB, a file
# takes a sixth more memory, 1 GB at most.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:${gs_cxx}--param=ggc-min-heapsize=600000>>")
endif()
if(GS_NATIVE)
  target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:${gs_cxx}-march=native>>")
else()  # for other machines: the same bytes wherever the sources and the build lie
  set(gs_prefix_maps "-ffile-prefix-map=${PROJECT_BINARY_DIR}=build" "-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.")
  target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:${gs_cxx}${gs_prefix_maps}>>")
  list(TRANSFORM gs_prefix_maps PREPEND -Xcompiler=)
  target_compile_options(gs_flags INTERFACE "$<BUILD_INTERFACE:$<$<COMPILE_LANGUAGE:CUDA>:${gs_prefix_maps}>>")
endif()
if(GS_STATIC_LIBRARIES)
  target_link_options(gs_flags INTERFACE $<BUILD_INTERFACE:-static-libstdc++> $<BUILD_INTERFACE:-static-libgcc>)
endif()
if(GS_SANITIZE STREQUAL "address")
  target_compile_options(gs_flags INTERFACE "${gs_cxx}-fsanitize=address,undefined;-fno-omit-frame-pointer;-fno-sanitize-recover=undefined>")
  target_link_options(gs_flags INTERFACE -fsanitize=address,undefined)
elseif(GS_SANITIZE STREQUAL "thread")
  target_compile_options(gs_flags INTERFACE "${gs_cxx}-fsanitize=thread;-fno-omit-frame-pointer>")
  target_link_options(gs_flags INTERFACE -fsanitize=thread)
endif()
if(GS_COVERAGE)  # threads count together, and a child process adds to what its parent counts
  target_compile_options(gs_flags INTERFACE "${gs_cxx}--coverage;-fprofile-update=atomic>")
  target_link_options(gs_flags INTERFACE --coverage)
endif()
if(GS_FUZZ)  # coverage for libFuzzer; only gs_fuzz_target() links its main()
  target_compile_options(gs_flags INTERFACE "${gs_cxx}-fsanitize=fuzzer-no-link>")
endif()

# gs_precompile(target [QUICKLY] [PROGRAM] headers...): headers that most files include, read once for
# all files of libraries, or of programs. Files have to include what they use all the same: the preset
# `minimal` builds without this.
function(gs_precompile target)
  cmake_parse_arguments(arg "QUICKLY;PROGRAM" "" "" ${ARGN})
  file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/${target}.cpp CONTENT "// Needed by CMake: ${target} has headers alone.\n")
  add_library(${target} OBJECT ${PROJECT_BINARY_DIR}/${target}.cpp)
  target_link_libraries(${target} PRIVATE gs_flags gs_glm gs_spdlog gs_json)
  target_precompile_headers(${target} PRIVATE
    ${PROJECT_SOURCE_DIR}/gs_core/types.h <spdlog/fmt/fmt.h> <nlohmann/json.hpp> <algorithm> <filesystem> <functional>
    <map> <memory> <optional> <string> <vector> ${arg_UNPARSED_ARGUMENTS})
  if(arg_QUICKLY)
    target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  endif()
  if(arg_PROGRAM)  # as CMake compiles the sources of a program
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE OFF)
    target_compile_options(${target} PRIVATE -fPIE)
  endif()
endfunction()

# gs_use_precompiled(target from): a compiler takes them only with the flags that they were made with.
function(gs_use_precompiled target from)
  if(GS_PRECOMPILE_HEADERS)
    target_precompile_headers(${target} REUSE_FROM ${from})
  endif()
endfunction()
if(GS_PRECOMPILE_HEADERS)
  gs_precompile(gs_headers)
  gs_precompile(gs_headers_quick QUICKLY)
endif()

# gs_library(name [EXPORT name] SOURCES ... PUBLIC ... PRIVATE ...): makes a static library. With
# EXPORT it is installed as gemsplat::name.
function(gs_library name)
  cmake_parse_arguments(arg "" "EXPORT" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${arg_SOURCES})
  target_link_libraries(${name} PUBLIC gs_flags ${arg_PUBLIC})
  foreach(library IN LISTS arg_PRIVATE)
    if(library IN_LIST GS_HEADER_LIBRARIES)  # headers only: users do not link it
      set(library $<BUILD_INTERFACE:${library}>)
    endif()
    target_link_libraries(${name} PRIVATE ${library})
  endforeach()
  if(NOT name MATCHES "^gs_(cuda|web)$")  # nvcc has no such headers, and the pages need no library
    gs_use_precompiled(${name} gs_headers)
  endif()
  if(arg_EXPORT)
    gs_install_library(${name} ${arg_EXPORT})
  endif()
endfunction()

# gs_use_library(target name [SOURCES ...] [INSTEAD ...] [INCLUDE ...] [LINK ...]): a library that a build
# may lack. With GS_HAVE_<name> it is linked, and SOURCES are compiled or, if none are given,
# GS_HAVE_<name> is defined for the code to ask. Without it, INSTEAD is compiled.
function(gs_use_library target name)
  cmake_parse_arguments(PARSE_ARGV 2 use "" "" "SOURCES;INSTEAD;INCLUDE;LINK")
  # A program may have its own functions in place of these (apps/cli/lazy), so each file is one that
  # the linker can leave.
  set_source_files_properties(${use_SOURCES} ${use_INSTEAD} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  if(NOT GS_HAVE_${name})
    target_sources(${target} PRIVATE ${use_INSTEAD})
    return()
  endif()
  target_sources(${target} PRIVATE ${use_SOURCES})
  if(NOT use_SOURCES)
    target_compile_definitions(${target} PRIVATE GS_HAVE_${name})
  endif()
  target_include_directories(${target} SYSTEM PRIVATE ${use_INCLUDE})
  target_link_libraries(${target} PRIVATE ${use_LINK})
endfunction()

# gs_compile_quickly(target): for code that is compiled often and whose speed does not matter.
function(gs_compile_quickly target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  gs_use_precompiled(${target} gs_headers_quick)
endfunction()

# gs_allow_unnamed_types(target): g++ warns of types of unnamed namespaces where it takes a file for a
# header, as it does with files that are compiled together.
function(gs_allow_unnamed_types target)
  if(GS_UNITY AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(${target} PRIVATE "${gs_cxx}-Wno-subobject-linkage>")
  endif()
endfunction()

# gs_compile_together(target [EXCEPT folders...]): the compiler reads the files of a folder at once, and their
# headers once. That halves a whole build. So names in unnamed namespaces are unique within a folder, and
# other ones than those of its headers, which they would hide from the files that follow.
# GS_UNITY=OFF compiles each file alone, which is quicker for somebody who changes single files. Code whose
# speed matters is compiled alone in both: its folders are those of EXCEPT.
function(gs_compile_together target)
  cmake_parse_arguments(arg "" "" "EXCEPT" ${ARGN})
  set_target_properties(${target} PROPERTIES UNITY_BUILD ${GS_UNITY} UNITY_BUILD_MODE GROUP)
  get_target_property(sources ${target} SOURCES)
  gs_allow_unnamed_types(${target})
  foreach(source IN LISTS sources)
    cmake_path(GET source PARENT_PATH folder)
    if(folder IN_LIST arg_EXCEPT)
      continue()
    endif()
    string(MAKE_C_IDENTIFIER "${target}_${folder}" group)
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${group})
  endforeach()
endfunction()

# gs_compile_folders_quickly(target folders...): gs_compile_quickly() for the files of these folders of a
# library alone, since a precompiled header serves one level of optimization. An object library compiles
# them, and the library holds its objects. Call it last: it takes what the library links and defines.
function(gs_compile_folders_quickly target)
  add_library(${target}_quick OBJECT)
  get_target_property(sources ${target} SOURCES)
  foreach(source IN LISTS sources)
    cmake_path(GET source PARENT_PATH folder)
    if(folder IN_LIST ARGN)
      list(REMOVE_ITEM sources ${source})
      target_sources(${target}_quick PRIVATE ${source})
    endif()
  endforeach()
  set_target_properties(${target} PROPERTIES SOURCES "${sources}")
  target_sources(${target} PRIVATE $<TARGET_OBJECTS:${target}_quick>)
  get_target_property(libraries ${target} LINK_LIBRARIES)
  get_target_property(definitions ${target} COMPILE_DEFINITIONS)
  target_link_libraries(${target}_quick PRIVATE ${libraries})
  if(definitions)
    target_compile_definitions(${target}_quick PRIVATE ${definitions})
  endif()
  gs_compile_quickly(${target}_quick)
  gs_compile_together(${target}_quick)
endfunction()

# gs_test(path [LINK ...]): adds tests/<path>.cpp to the program of its folder, which links everything.
# If a library of LINK is missing, the test is left out and named in the summary. For example
# gs_test(math/sh_test) makes math_tests, which `ctest -R math` runs whole. The target train_tests builds
# the programs of all folders of tests/train, and `ctest -L train` runs them.
function(gs_test path)
  cmake_parse_arguments(arg "" "" "LINK" ${ARGN})
  foreach(library IN LISTS arg_LINK)
    if(NOT TARGET ${library})
      gs_leave_out(${path} ${library})
      return()
    endif()
  endforeach()
  cmake_path(GET path PARENT_PATH folder)
  string(REPLACE "/" "_" name ${folder}_tests)
  if(NOT TARGET ${name})
    gs_test_program(${name} ${folder})
  endif()
  target_sources(${name} PRIVATE ${path}.cpp)
  target_link_libraries(${name} PRIVATE ${arg_LINK})
endfunction()

# gs_test_program(name folder): the program that holds the tests of a folder, and what CTest runs of it.
# The tests of a GPU are entries of their own, since a kernel that fails ends the process's use of it.
# A folder whose tests take long has several entries, for example cli/1 to cli/4, each with its share.
function(gs_test_program name folder)
  add_executable(${name})
  target_link_libraries(${name} PRIVATE gs_test_support GTest::gmock_main)
  gs_compile_quickly(${name})
  gs_use_precompiled(${name} gs_headers_of_tests)
  if(folder IN_LIST gs_folders_together)
    set_target_properties(${name} PROPERTIES UNITY_BUILD ${GS_UNITY} UNITY_BUILD_BATCH_SIZE 6)
    gs_allow_unnamed_types(${name})
  endif()
  string(REGEX MATCH "^[^/]+" label ${folder})
  if(NOT label STREQUAL folder)
    if(NOT TARGET ${label}_tests)
      add_custom_target(${label}_tests)
    endif()
    add_dependencies(${label}_tests ${name})
  endif()
  set(properties LABELS ${label} TIMEOUT 1800)
  set(environment XDG_CACHE_HOME=${CMAKE_CURRENT_BINARY_DIR}/cache)
  if(folder STREQUAL "cuda")
    gtest_discover_tests(${name} TEST_PREFIX "${folder}." PROPERTIES ${properties} ENVIRONMENT ${environment}
                         DISCOVERY_MODE PRE_TEST WORKING_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
    return()
  endif()
  set(shares 1)
  if(DEFINED gs_shares_${label})
    set(shares ${gs_shares_${label}})
  endif()
  foreach(share RANGE 1 ${shares})
    set(entry ${folder})
    if(shares GREATER 1)
      math(EXPR index "${share} - 1")
      set(entry ${folder}/${share})
      set(shard GTEST_TOTAL_SHARDS=${shares} GTEST_SHARD_INDEX=${index})
    endif()
    add_test(NAME ${entry} COMMAND ${name} --gtest_brief=1 WORKING_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
    set_tests_properties(${entry} PROPERTIES ${properties} ENVIRONMENT "${environment};${shard}")
  endforeach()
endfunction()

# gs_fuzz_target(name): builds tests/fuzz/<name>.cpp as fuzz_<name>, a program of libFuzzer.
function(gs_fuzz_target name)
  add_executable(fuzz_${name} fuzz/${name}.cpp)
  target_link_libraries(fuzz_${name} PRIVATE fuzz_main gs_test_support gs_experiment gs_view)
  target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  add_dependencies(fuzz_targets fuzz_${name})
endfunction()

# gs_benchmark(path): builds tests/<path>.cpp with Google Benchmark. Without it the benchmark is left
# out and named in the summary.
function(gs_benchmark path)
  if(NOT TARGET benchmark::benchmark_main)
    gs_leave_out(${path} benchmark::benchmark_main)
    return()
  endif()
  string(REPLACE "/" "_" name ${path})
  add_executable(${name} ${path}.cpp)
  target_link_libraries(${name} PRIVATE gs_test_support benchmark::benchmark_main)
endfunction()
