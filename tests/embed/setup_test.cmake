# SPDX-License-Identifier: Apache-2.0
# cmake -DBUILD=... -DSOURCE=... -DNINJA=... -DWORK=... -P setup_test.cmake: scripts/setup.sh builds
# everything that `cmake --install` copies out of the build folder; an installation leaves out a Python
# module that is not built; and a build shows its progress in a pipe.

# ---- the target that setup.sh builds has all files of the install rules --------------------------------------
file(READ ${SOURCE}/scripts/setup.sh setup)
if(NOT setup MATCHES "\nbuild default installed\n")
  message(FATAL_ERROR "scripts/setup.sh does not build the target `installed`")
endif()
execute_process(COMMAND ${NINJA} -C ${BUILD} -t query installed OUTPUT_VARIABLE built COMMAND_ERROR_IS_FATAL ANY)
file(GLOB rules ${BUILD}/cmake_install.cmake ${BUILD}/*/cmake_install.cmake ${BUILD}/*/*/cmake_install.cmake)
set(found 0)
foreach(file IN LISTS rules)
  file(READ ${file} text)
  string(REGEX MATCHALL "FILES \"${BUILD}/[^\"]+" entries "${text}")
  foreach(entry IN LISTS entries)
    string(REPLACE "FILES \"${BUILD}/" "" name "${entry}")
    if(name MATCHES "\\.(a|so)$" OR name MATCHES "^bin/")
      math(EXPR found "${found} + 1")
      if(NOT built MATCHES "[ |]${name}\n")
        message(FATAL_ERROR "cmake --install copies ${name}, and scripts/setup.sh does not build it")
      endif()
    endif()
  endforeach()
endforeach()
if(found LESS 6)  # five libraries and the program
  message(FATAL_ERROR "only ${found} built files were found in the install rules")
endif()

# ---- an installation without the Python module ------------------------------------------------------------------
set(rule ${BUILD}/apps/python/cmake_install.cmake)
if(EXISTS ${rule})
  file(READ ${rule} text)
  string(REGEX REPLACE "(_gemsplat[^\"/]*)\\.so" "\\1.absent.so" text "${text}")
  file(WRITE ${WORK}/without_module.cmake "${text}")
  execute_process(COMMAND ${CMAKE_COMMAND} -DCMAKE_INSTALL_PREFIX=${WORK}/prefix -P ${WORK}/without_module.cmake
    RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT code STREQUAL "0" OR NOT output MATCHES "not built.*scripts/setup.sh")
    message(FATAL_ERROR "installing without the Python module (${code}):\n${output}")
  endif()
endif()

# ---- progress in a pipe -----------------------------------------------------------------------------------------
function(expect_progress seconds expected)
  execute_process(COMMAND bash -c "source '${SOURCE}/scripts/common.sh'; printf '%s\\n' '@@ 1 3 Building CXX object a.o' \
    'a.cpp:1: warning: b' '@@ 2 3 Building CXX object c.o' '@@ 3 3 Linking' | GS_PROGRESS_SECONDS=${seconds} show_progress"
    OUTPUT_VARIABLE output COMMAND_ERROR_IS_FATAL ANY)
  if(NOT output STREQUAL "${expected}")
    message(FATAL_ERROR "show_progress printed\n${output}instead of\n${expected}")
  endif()
endfunction()
set(first "   33% of the build: 1 of 3 steps, 0 min\na.cpp:1: warning: b\n")
set(last "   100% of the build: 3 of 3 steps, 0 min\n")
expect_progress(0 "${first}   66% of the build: 2 of 3 steps, 0 min\n${last}")
expect_progress(1000 "${first}${last}")
