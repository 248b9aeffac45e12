# SPDX-License-Identifier: Apache-2.0
# cmake -DSCRIPTS=FOLDER -DWORK=FOLDER -P write_commit_test.cmake: scripts/cmake/write_commit.cmake
# names the commit of the source tree, not that of a repository around it, and prints nothing.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/expect.cmake)
foreach(variable GIT_DIR GIT_WORK_TREE GS_COMMIT)
  unset(ENV{${variable}})
endforeach()

# write_commit(result source): the commit in the file that is written for this source tree.
function(write_commit result source)
  execute_process(COMMAND ${CMAKE_COMMAND} -DSOURCE=${source} -DOUTPUT=${WORK}/commit.cpp -DDIFF=${WORK}/bin/uncommitted.diff
      -P ${SCRIPTS}/write_commit.cmake
    OUTPUT_VARIABLE printed ERROR_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
  expect_equal("What write_commit.cmake prints" "${printed}" "")
  file(READ ${WORK}/commit.cpp text)
  string(REGEX MATCH "return \"([^\"]*)\"" found "${text}")
  set(${result} "${CMAKE_MATCH_1}" PARENT_SCOPE)
endfunction()

# expect_diff(LINE...): these lines of the diff, in this order, among those that name files or add
# lines. Without lines there is no diff.
function(expect_diff)
  set(found "")
  if(EXISTS ${WORK}/bin/uncommitted.diff)
    file(READ ${WORK}/bin/uncommitted.diff text)
    string(REPLACE ";" "" text "${text}")
    string(REGEX MATCHALL "diff --git [^\n]*|\n[+][^+\n]+" found "${text}")
    string(REPLACE "\n" "" found "${found}")
  endif()
  string(REPLACE ";" "|" found "${found}")
  list(JOIN ARGN "|" wanted)
  expect_equal("The uncommitted changes" "${found}" "${wanted}")
  file(GLOB left ${WORK}/bin/*)
  list(REMOVE_ITEM left ${WORK}/bin/uncommitted.diff)
  expect_equal("Files that are left" "${left}" "")
endfunction()

file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/repository/inside)
execute_process(COMMAND git init --quiet ${WORK}/repository COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND git -C ${WORK}/repository -c user.name=test -c user.email=test@localhost
  commit --quiet --allow-empty --message=test COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND git -C ${WORK}/repository rev-parse --short=12 HEAD
  OUTPUT_VARIABLE head OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)

write_commit(commit ${WORK}/repository)
expect_equal("The commit of a repository" "${commit}" "${head}")
write_commit(commit ${WORK}/repository/inside)
expect_equal("The commit of a tree without .git inside a repository" "${commit}" "unknown")
file(CREATE_LINK ${WORK}/repository ${WORK}/link SYMBOLIC)
write_commit(commit ${WORK}/link)
expect_equal("The commit of a repository behind a symbolic link" "${commit}" "${head}")
file(WRITE ${WORK}/repository/file.txt "one")
execute_process(COMMAND git -C ${WORK}/repository add file.txt COMMAND_ERROR_IS_FATAL ANY)
write_commit(commit ${WORK}/repository)
expect_equal("The commit of a repository with changes" "${commit}" "${head}-dirty")
expect_diff("diff --git a/file.txt b/file.txt" "+one")

# New sources are in the diff, other new files are not, and git's own index does not change.
file(WRITE ${WORK}/repository/new.cpp "int two;")
file(WRITE ${WORK}/repository/points.bin "three")
write_commit(commit ${WORK}/repository)
expect_diff("diff --git a/file.txt b/file.txt" "+one" "diff --git a/new.cpp b/new.cpp" "+int two")
execute_process(COMMAND git -C ${WORK}/repository status --porcelain OUTPUT_VARIABLE status COMMAND_ERROR_IS_FATAL ANY)
expect_equal("What git says after that" "${status}" "A  file.txt\n?? new.cpp\n?? points.bin\n")
write_commit(commit ${WORK}/repository/inside)
expect_diff()
set(ENV{GS_COMMIT} abc123)
write_commit(commit ${WORK}/repository/inside)
expect_equal("The commit that GS_COMMIT names" "${commit}" "abc123")
