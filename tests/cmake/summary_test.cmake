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
