# SPDX-License-Identifier: Apache-2.0
# cpack runs this on the files that it packs: Debian wants compressed man pages, and for each package
# a file named `copyright` and a changelog. No time stamp and no permission of the machine that packs
# is left, so that a commit gives the same bytes.
set(root ${CPACK_TEMPORARY_INSTALL_DIRECTORY})
file(GLOB_RECURSE pages ${root}/*.1)
list(FILTER pages INCLUDE REGEX "/man/man1/")
foreach(page IN LISTS pages)
  execute_process(COMMAND gzip -9n ${page} COMMAND_ERROR_IS_FATAL ANY)
endforeach()

# NOTICE, which the program's files bring, speaks of all packages of the build.
set(copyright "")
file(GLOB_RECURSE notice ${root}/NOTICE)
if(notice)
  cmake_path(GET notice PARENT_PATH folder)
  file(READ ${notice} copyright)
  file(REMOVE ${notice} ${folder}/LICENSE)  # every Debian system has the text
  string(APPEND copyright "\nThe Apache License, Version 2.0, is in /usr/share/common-licenses/Apache-2.0.\n")
endif()

# describe_package(folder package): `folder` holds what becomes the package.
function(describe_package folder package)
  set(documents ${folder}${CPACK_PACKAGING_INSTALL_PREFIX}/share/doc/${package})
  if(copyright)
    file(WRITE ${documents}/copyright "${copyright}")
  endif()
  if(CPACK_GS_PYTHON3)
    file(MAKE_DIRECTORY ${documents})
    execute_process(COMMAND ${CPACK_GS_PYTHON3} ${CMAKE_CURRENT_LIST_DIR}/../release/changelog.py --package ${package}
      --version ${CPACK_PACKAGE_VERSION} --release ${CPACK_DEBIAN_PACKAGE_RELEASE} --maintainer "${CPACK_PACKAGE_CONTACT}"
      ${CPACK_GS_CHANGELOG} ${documents}/changelog.Debian.gz COMMAND_ERROR_IS_FATAL ANY)
  endif()
endfunction()

if(CPACK_COMPONENTS_ALL)
  foreach(component IN LISTS CPACK_COMPONENTS_ALL)
    string(TOUPPER ${component} name)
    describe_package(${root}/${component} ${CPACK_DEBIAN_${name}_PACKAGE_NAME})
  endforeach()
else()
  describe_package(${root} ${CPACK_PACKAGE_NAME})
endif()

# nvcc writes the number of its process into each object, as the name of a file.
file(GLOB_RECURSE libraries ${root}/*.a)
foreach(library IN LISTS libraries)
  execute_process(COMMAND strip --strip-debug --enable-deterministic-archives ${library} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
execute_process(COMMAND chmod -R u=rwX,go=rX ${root} COMMAND_ERROR_IS_FATAL ANY)
