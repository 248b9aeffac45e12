# SPDX-License-Identifier: Apache-2.0
# cmake -DSCRIPTS=FOLDER -P summary_test.cmake: the configure summary tells what is missing from
# what was switched off.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/expect.cmake)
include(${SCRIPTS}/summary.cmake)

set(GS_WITH_THING ON)
gs_report("found" GS_WITH_THING TRUE "nothing works")
gs_report("not found" GS_WITH_THING FALSE "nothing works")
set(GS_WITH_THING OFF)
gs_report("switched off" GS_WITH_THING FALSE "nothing works")
gs_report("packed" GS_WITH_THING TRUE "nothing works")
get_property(summary GLOBAL PROPERTY GS_SUMMARY)
expect_equal("The summary" "${summary}" "  found: yes
  not found: MISSING, without it: nothing works
  switched off: off (GS_WITH_THING=OFF), without it: nothing works
  packed: yes
")

# What the program can do is told with what to install.
set(GS_WITH_THING ON)
gs_report("there" GS_WITH_THING TRUE "nothing works" "everything works" libthing-dev)
gs_report("lacking" GS_WITH_THING FALSE "nothing works" "everything works" libthing-dev)
gs_write_features(${CMAKE_CURRENT_BINARY_DIR}/features.h)
file(READ ${CMAKE_CURRENT_BINARY_DIR}/features.h features)
file(REMOVE ${CMAKE_CURRENT_BINARY_DIR}/features.h)
expect_in("The features" "${features}" [[{"there", true, "everything works"},
    {"lacking", false, "nothing works; install libthing-dev and build again"},
]])

# Every library is reported with an option that there is.
file(STRINGS ${SCRIPTS}/options.cmake options REGEX "^option")
file(GLOB scripts ${SCRIPTS}/*.cmake)
foreach(script IN LISTS scripts)
  file(STRINGS ${script} reports REGEX "^ *gs_report\\(\"")
  foreach(report IN LISTS reports)
    string(REGEX MATCH "\" (GS_[A-Z_]+) \"" found "${report}")
    expect_in("An option of ${script}: ${report}" "${options}" "option(${CMAKE_MATCH_1} ")
  endforeach()
endforeach()
