# SPDX-License-Identifier: Apache-2.0
# cmake -DSOURCE=FOLDER -DOUTPUT=FILE -P write_commit.cmake: writes the commit that is built as a C++ file, and only where it
# differs from the one there. GS_COMMIT in the environment stands in for a tree without git.
set(commit "$ENV{GS_COMMIT}")
if(commit STREQUAL "")
  execute_process(COMMAND git -C ${SOURCE} describe --always --dirty --abbrev=12 --exclude=*
    OUTPUT_VARIABLE commit RESULT_VARIABLE failed ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(failed)
    set(commit "unknown")
  endif()
endif()
string(REGEX REPLACE "[^A-Za-z0-9._-]" "" commit "${commit}")
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "#include \"gs_app/run/provenance.h\"\n\nnamespace gs {\n\nconst char* built_commit() { return \"@commit@\"; }\n\n}  // namespace gs\n" @ONLY)
