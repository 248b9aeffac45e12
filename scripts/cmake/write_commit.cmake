# SPDX-License-Identifier: Apache-2.0
# cmake -DSOURCE=FOLDER -DOUTPUT=FILE [-DDIFF=FILE] -P write_commit.cmake
#
# Writes the commit that is built as a C++ file, and only if it has changed. The variable GS_COMMIT
# of the environment replaces git. The commit is "unknown" for a tree without .git, also inside
# another repository. DIFF gets what differs from the commit, with new source files that git does
# not ignore; it is removed where nothing differs or nothing is known.
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

# write_diff(): DIFF through a copy of git's index, to which new files are added.
function(write_diff)
  git_says(index rev-parse --path-format=absolute --git-path index)
  if(NOT EXISTS ${index})
    return()
  endif()
  # data, of which a tree may hold gigabytes, is left out
  git_says(new ls-files --others --exclude-standard -- *.h *.cpp *.cu *.cuh *.cmake *CMakeLists.txt *.in *.js *.mjs *.css *.toml)
  string(REPLACE "\n" ";" new "${new}")
  set(copy ${DIFF}.index)
  configure_file(${index} ${copy} COPYONLY)
  set(ENV{GIT_INDEX_FILE} ${copy})
  if(new)
    git_says(added add --intent-to-add -- ${new})
  endif()
  execute_process(COMMAND git -C ${SOURCE} diff --no-color --no-ext-diff --no-textconv --src-prefix=a/ --dst-prefix=b/ HEAD
    OUTPUT_FILE ${DIFF}.new RESULT_VARIABLE code ERROR_QUIET)
  unset(ENV{GIT_INDEX_FILE})
  file(REMOVE ${copy} ${copy}.lock)
  file(SIZE ${DIFF}.new size)
  if(code STREQUAL "0" AND size GREATER 0)
    file(RENAME ${DIFF}.new ${DIFF})
  else()
    file(REMOVE ${DIFF}.new ${DIFF})
  endif()
endfunction()

set(commit "$ENV{GS_COMMIT}")
if(DIFF)
  cmake_path(GET DIFF PARENT_PATH folder)
  file(MAKE_DIRECTORY ${folder})
  file(REMOVE ${DIFF})
endif()
if(commit STREQUAL "")
  file(REAL_PATH ${SOURCE} source)
  git_says(repository rev-parse --show-toplevel)
  if(repository STREQUAL source)
    git_says(commit describe --always --dirty --abbrev=12 --exclude=*)
    if(DIFF AND NOT commit STREQUAL "")
      write_diff()
    endif()
  endif()
endif()
if(commit STREQUAL "")
  set(commit "unknown")
endif()
string(REGEX REPLACE "[^A-Za-z0-9._-]" "" commit "${commit}")
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "#include \"gs_app/run/provenance.h\"\n\nnamespace gs {\n\nconst char* built_commit() { return \"@commit@\"; }\n\n}  // namespace gs\n" @ONLY)
