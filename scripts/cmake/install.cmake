# SPDX-License-Identifier: Apache-2.0
# `cmake --install` writes the program, the libraries with their headers, an example, the Python
# module, and the package that find_package(gemsplat) reads (docs/reference/cpp.md). Each of the
# components program, dev and python is one Debian package (package.cmake).
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(GS_INSTALL_INCLUDE_DIR ${CMAKE_INSTALL_INCLUDEDIR}/gemsplat)  # headers name each other by their folders in here
set(GS_INSTALL_PACKAGE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/gemsplat)

# Builds what `cmake --install` copies, and no tests: for scripts/setup.sh.
add_custom_target(installed)

# gs_install_library(target name): installs the library and the headers of its folder. Other
# projects link it as gemsplat::name.
function(gs_install_library target name)
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  install(TARGETS ${target} EXPORT gemsplat ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
  add_dependencies(installed ${target})
  cmake_path(RELATIVE_PATH CMAKE_CURRENT_SOURCE_DIR BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE folder)
  install(DIRECTORY . DESTINATION ${GS_INSTALL_INCLUDE_DIR}/${folder} COMPONENT dev FILES_MATCHING PATTERN "*.h")
endfunction()

# gs_install_package(): what is not a library's own; called when all targets are known.
function(gs_install_package)
  foreach(target gs_flags gs_glm gs_fmt gs_spdlog)  # of headers alone; the package finds the last three again
    string(REPLACE "gs_" "" name ${target})
    set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
    install(TARGETS ${target} EXPORT gemsplat COMPONENT dev)
  endforeach()
  install(EXPORT gemsplat NAMESPACE gemsplat:: FILE gemsplatTargets.cmake DESTINATION ${GS_INSTALL_PACKAGE_DIR} COMPONENT dev)
  set(package ${PROJECT_BINARY_DIR}/package)
  configure_package_config_file(${PROJECT_SOURCE_DIR}/scripts/cmake/gemsplatConfig.cmake.in ${package}/gemsplatConfig.cmake
    INSTALL_DESTINATION ${GS_INSTALL_PACKAGE_DIR})
  write_basic_package_version_file(${package}/gemsplatConfigVersion.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${package}/gemsplatConfig.cmake ${package}/gemsplatConfigVersion.cmake DESTINATION ${GS_INSTALL_PACKAGE_DIR} COMPONENT dev)
  install(DIRECTORY examples/embed_cpp/ DESTINATION ${CMAKE_INSTALL_DATADIR}/gemsplat/example COMPONENT dev)
  # The bundled scene: `gemsplat train PREFIX/share/gemsplat/courtyard -c cpu_tiny` is the demo.
  install(DIRECTORY examples/courtyard/images examples/courtyard/sparse DESTINATION ${CMAKE_INSTALL_DATADIR}/gemsplat/courtyard
    COMPONENT program)
  install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
endfunction()
