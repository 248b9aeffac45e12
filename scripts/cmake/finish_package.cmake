# SPDX-License-Identifier: Apache-2.0
# cpack runs this on the files that it packs: Debian wants compressed man pages, and a file named
# `copyright`. No time stamp and no permission of the machine that packs is left, so that a commit
# gives the same bytes.
file(GLOB_RECURSE pages ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*.1)
list(FILTER pages INCLUDE REGEX "/man/man1/")
foreach(page IN LISTS pages)
  execute_process(COMMAND gzip -9n ${page} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
file(GLOB_RECURSE notice ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/NOTICE)
if(notice)
  cmake_path(GET notice PARENT_PATH folder)
  file(RENAME ${notice} ${folder}/copyright)
  file(REMOVE ${folder}/LICENSE)  # every Debian system has the text
  file(APPEND ${folder}/copyright "\nThe Apache License, Version 2.0, is in /usr/share/common-licenses/Apache-2.0.\n")
endif()
# nvcc writes the number of its process into each object, as the name of a file.
file(GLOB_RECURSE libraries ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/*.a)
foreach(library IN LISTS libraries)
  execute_process(COMMAND strip --strip-debug --enable-deterministic-archives ${library} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
execute_process(COMMAND chmod -R u=rwX,go=rX ${CPACK_TEMPORARY_INSTALL_DIRECTORY} COMMAND_ERROR_IS_FATAL ANY)
