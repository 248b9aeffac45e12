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
  execute_process(COMMAND ${CMAKE_COMMAND} -DSOURCE=${source} -DOUTPUT=${WORK}/commit.cpp -P ${SCRIPTS}/write_commit.cmake
    OUTPUT_VARIABLE printed ERROR_VARIABLE printed COMMAND_ERROR_IS_FATAL ANY)
  expect_equal("What write_commit.cmake prints" "${printed}" "")
  file(READ ${WORK}/commit.cpp text)
  string(REGEX MATCH "return \"([^\"]*)\"" found "${text}")
  set(${result} "${CMAKE_MATCH_1}" PARENT_SCOPE)
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
set(ENV{GS_COMMIT} abc123)
write_commit(commit ${WORK}/repository/inside)
expect_equal("The commit that GS_COMMIT names" "${commit}" "abc123")
