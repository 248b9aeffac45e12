# SPDX-License-Identifier: Apache-2.0
# What the tests of scripts/cmake share.

# expect_equal(what got wanted)
function(expect_equal what got wanted)
  if(NOT "${got}" STREQUAL "${wanted}")
    message(SEND_ERROR "${what}:\n  is        ${got}\n  should be ${wanted}")
  endif()
endfunction()

# expect_in(what text part)
function(expect_in what text part)
  string(FIND "${text}" "${part}" at)
  if(at EQUAL -1)
    message(SEND_ERROR "${what}: '${part}' is not in\n${text}")
  endif()
endfunction()
