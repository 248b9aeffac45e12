# SPDX-License-Identifier: Apache-2.0
# cpack reads this first: a package must run on machines other than the one that built it.
if(CPACK_GS_NATIVE)
  message(FATAL_ERROR "This build is for the processor of this machine (GS_NATIVE=ON), and other machines may lack its instructions. "
                      "scripts/release.sh builds what can be packed; `cmake --preset package` configures it.")
endif()
