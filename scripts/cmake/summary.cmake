# SPDX-License-Identifier: Apache-2.0
# The configure summary: what was found, what is missing, and what was switched off.

# gs_report(name option found purpose): remembers a line for the summary. `option` names the GS_
# option that switches the library on; `purpose` says what is lost without it.
function(gs_report name option found purpose)
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

# Prints the summary as a NOTICE, so that `--log-level=NOTICE` prints this and no more.
function(gs_print_summary)
  get_property(summary GLOBAL PROPERTY GS_SUMMARY)
  message(NOTICE "gemsplat ${PROJECT_VERSION}, ${CMAKE_BUILD_TYPE}:\n${summary}")
endfunction()
