# SPDX-License-Identifier: Apache-2.0
# What was found, what is missing, and what was switched off: the configure summary, and the list that
# `gemsplat info` prints of a built program.

# gs_report(name option found purpose [can package]): remembers a line for the summary. `option` names
# the GS_ option that switches the library on; `purpose` says what is lost without it. With `can`, what
# the program does with it, it is a feature of the program: `package` is what to install for it.
function(gs_report name option found purpose)
  if(ARGC GREATER 4)
    set(is_there false)
    set(detail "${purpose}; install ${ARGV5} and build again")
    if(found)
      set(is_there true)
      set(detail "${ARGV4}")
    endif()
    set_property(GLOBAL APPEND_STRING PROPERTY GS_FEATURES "    {\"${name}\", ${is_there}, \"${detail}\"},\n")
  endif()
  if(found)
    set(line "${name}: yes")
  elseif(NOT ${option})
    set(line "${name}: off (${option}=OFF), without it: ${purpose}")
  else()
    set(line "${name}: MISSING, without it: ${purpose}")
  endif()
  set_property(GLOBAL APPEND_STRING PROPERTY GS_SUMMARY "  ${line}\n")
endfunction()

# gs_report_value(name value): remembers a line that tells a value.
function(gs_report_value name value)
  set_property(GLOBAL APPEND_STRING PROPERTY GS_SUMMARY "  ${name}: ${value}\n")
endfunction()

# gs_leave_out(test library): remembers a test that cannot be built here.
function(gs_leave_out test library)
  set_property(GLOBAL APPEND_STRING PROPERTY GS_SUMMARY "  tests/${test}: left out, needs ${library}\n")
endfunction()

# gs_write_features(file): writes the features of the program as a header for gs_app/jobs/parts/capabilities.cpp.
function(gs_write_features file)
  get_property(features GLOBAL PROPERTY GS_FEATURES)
  file(CONFIGURE OUTPUT ${file} @ONLY CONTENT "// What CMake has found; written by scripts/cmake/summary.cmake.
#pragma once

namespace gs {

struct Feature {
  const char* name;
  bool is_there;
  const char* detail;  // what it is for; where it is missing, what then cannot be done
};
inline constexpr Feature kFeatures[] = {
@features@};

}  // namespace gs
")
endfunction()

# Prints the summary as a NOTICE, so that `--log-level=NOTICE` prints this and no more.
function(gs_print_summary)
  get_property(summary GLOBAL PROPERTY GS_SUMMARY)
  message(NOTICE "gemsplat ${PROJECT_VERSION}, ${CMAKE_BUILD_TYPE}:\n${summary}")
endfunction()
