# SPDX-License-Identifier: Apache-2.0
# cmake -DSOURCE=FOLDER -DOUTPUT=FILE -P write_commit.cmake
#
# Writes the commit that is built as a C++ file, and only if it has changed. The variable GS_COMMIT
# of the environment replaces git. The commit is "unknown" for a tree without .git, also inside
# another repository.
cmake_minimum_required(VERSION 3.25)

# git_says(result ARGUMENT...): what git prints in SOURCE; empty where it fails.
function(git_says result)
  execute_process(COMMAND git -C ${SOURCE} ${ARGN}
    OUTPUT_VARIABLE answer RESULT_VARIABLE code ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(NOT code STREQUAL "0")
    set(answer "")
  endif()
  set(${result} "${answer}" PARENT_SCOPE)
endfunction()

set(commit "$ENV{GS_COMMIT}")
if(commit STREQUAL "")
  file(REAL_PATH ${SOURCE} source)
  git_says(repository rev-parse --show-toplevel)
  if(repository STREQUAL source)
    git_says(commit describe --always --dirty --abbrev=12 --exclude=*)
  endif()
endif()
if(commit STREQUAL "")
  set(commit "unknown")
endif()
string(REGEX REPLACE "[^A-Za-z0-9._-]" "" commit "${commit}")
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "#include \"gs_app/run/provenance.h\"\n\nnamespace gs {\n\nconst char* built_commit() { return \"@commit@\"; }\n\n}  // namespace gs\n" @ONLY)
