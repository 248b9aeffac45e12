# SPDX-License-Identifier: Apache-2.0
# Man pages, completions, NOTICE and SBOM, which the build makes, and Debian packages (`cpack -G DEB`).
# scripts/release.sh makes all packages of a release; docs/develop/releases.md explains them.

# What is inside this build, in the words of scripts/release/third_party.json.
set(gs_has "")
foreach(part OPENIMAGEIO OPENCV CERES ZLIB ZSTD WEBP PUGIXML CUDA PYTHON WEB)
  if(GS_HAVE_${part})
    list(APPEND gs_has ${part})
  endif()
endforeach()
if(NOT GS_HAVE_OPENIMAGEIO)
  list(APPEND gs_has STB)
  if(GS_HAVE_LIBJPEG)
    list(APPEND gs_has LIBJPEG)
  endif()
endif()
list(JOIN gs_has "," gs_has)
set(GS_BUILD_HAS "${gs_has}" CACHE INTERNAL "")  # read by scripts/release.sh
find_program(GS_PYTHON3 python3)

# gs_add_documents(): the program writes its own pages; notices.py writes NOTICE and sbom.spdx.json.
function(gs_add_documents)
  set(share ${PROJECT_BINARY_DIR}/share)
  add_custom_command(OUTPUT ${share}/man/man1/gemsplat.1 COMMENT "Writing man pages and completions"
    COMMAND gemsplat self-doc ${share} --replace DEPENDS gemsplat VERBATIM)
  add_custom_target(gs_manual ALL DEPENDS ${share}/man/man1/gemsplat.1)
  add_dependencies(installed gs_manual)
  # scripts/demo.sh builds the program alone, which can be installed without them.
  foreach(folder man bash-completion zsh fish)
    install(DIRECTORY ${share}/${folder} DESTINATION ${CMAKE_INSTALL_DATADIR} COMPONENT program OPTIONAL)
  endforeach()
  if(NOT GS_PYTHON3)
    return()
  endif()
  set(tools ${PROJECT_SOURCE_DIR}/scripts/release)
  set(notices ${PROJECT_BINARY_DIR}/notices)
  set(static)
  if(GS_STATIC_LIBRARIES)
    set(static --static)
  endif()
  add_custom_command(OUTPUT ${notices}/NOTICE ${notices}/sbom.spdx.json COMMENT "Writing NOTICE and SBOM"
    COMMAND ${GS_PYTHON3} ${tools}/notices.py write --have "${GS_BUILD_HAS}" ${static} --version ${PROJECT_VERSION}
      --cuda "${CMAKE_CUDA_COMPILER_VERSION}" ${notices}
    DEPENDS ${tools}/notices.py ${tools}/third_party.json ${PROJECT_SOURCE_DIR}/apps/web/package-lock.json VERBATIM)
  add_custom_target(gs_notices ALL DEPENDS ${notices}/NOTICE)
  add_dependencies(installed gs_notices)
  install(FILES ${notices}/NOTICE ${notices}/sbom.spdx.json DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program OPTIONAL)
endfunction()

# gs_distribution(result): bookworm, noble, ...; empty where /etc/os-release does not say.
function(gs_distribution result)
  set(${result} "" PARENT_SCOPE)
  if(EXISTS /etc/os-release)
    file(STRINGS /etc/os-release line REGEX "^VERSION_CODENAME=")
    string(REGEX REPLACE "^VERSION_CODENAME=\"?([a-z]*).*" "\\1" name "${line}")
    set(${result} "${name}" PARENT_SCOPE)
  endif()
endfunction()

# gs_packages_of_headers(result): what projects that link the libraries need. OpenImageIO's CMake package
# asks for its tools, too, and for the packages of Imath.
function(gs_packages_of_headers result)
  set(packages libglm-dev libfmt-dev libspdlog-dev)
  foreach(pair OPENIMAGEIO:libopenimageio-dev OPENIMAGEIO:openimageio-tools OPENIMAGEIO:libopenexr-dev OPENIMAGEIO:libimath-dev
          OPENCV:libopencv-dev CERES:libceres-dev ZLIB:zlib1g-dev
          ZSTD:libzstd-dev ZSTD:libxxhash-dev WEBP:libwebp-dev PUGIXML:libpugixml-dev)
    string(REPLACE ":" ";" pair ${pair})
    list(GET pair 0 part)
    list(GET pair 1 package)
    if(GS_HAVE_${part})
      list(APPEND packages ${package})
    endif()
  endforeach()
  list(JOIN packages ", " packages)
  set(${result} "${packages}" PARENT_SCOPE)
endfunction()

# gs_maintainer(result): who answers for the packages, in the variables of Debian's own tools. The
# project has no address, so that of a package whose maker names none is in a domain that cannot exist.
function(gs_maintainer result)
  set(name "The gemsplat developers")
  set(address noreply@gemsplat.invalid)
  if(NOT "$ENV{DEBEMAIL}" STREQUAL "")
    set(address "$ENV{DEBEMAIL}")
  endif()
  if(NOT "$ENV{DEBFULLNAME}" STREQUAL "")
    set(name "$ENV{DEBFULLNAME}")
  endif()
  set(${result} "${name} <${address}>" PARENT_SCOPE)
endfunction()

gs_add_documents()
gs_distribution(gs_codename)
set(GS_DISTRO "${gs_codename}" CACHE STRING "The distribution that Debian packages are for; part of their version")

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME gemsplat)
set(CPACK_PACKAGE_VENDOR "The gemsplat developers")
gs_maintainer(CPACK_PACKAGE_CONTACT)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_THREADS 0)
set(CPACK_COMPONENTS_ALL program dev)
if(GS_HAVE_PYTHON)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE "1~${GS_DISTRO}")
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME gemsplat)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS colmap)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "trains 3D Gaussians from photos
A program for 3D Gaussian Splatting: it trains a scene from photos, renders
it, shows it in the browser and writes the formats of other programs. It
computes on an NVIDIA GPU where there is one, and else on the CPU.")
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libgemsplat-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)
gs_packages_of_headers(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_DEV_DESCRIPTION "trains 3D Gaussians from photos: C++ libraries
Static libraries and headers for find_package(gemsplat), with an example.")
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-gemsplat)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
if(GS_HAVE_PYTHON)
  math(EXPR gs_next_minor "${Python3_VERSION_MINOR} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
    "python3 (>= 3.${Python3_VERSION_MINOR}), python3 (<< 3.${gs_next_minor}), python3-numpy")
endif()
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/scripts/release/debian/postinst ${PROJECT_SOURCE_DIR}/scripts/release/debian/prerm)
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PYTHON_DESCRIPTION "trains 3D Gaussians from photos: Python module
The module gemsplat, which works with NumPy arrays.")

# What check_package.cmake and finish_package.cmake ask for, when cpack runs.
set(CPACK_GS_NATIVE ${GS_NATIVE})
set(CPACK_GS_CHANGELOG ${PROJECT_SOURCE_DIR}/CHANGELOG.md)
set(CPACK_GS_PYTHON3 ${GS_PYTHON3})
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/scripts/cmake/check_package.cmake)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/scripts/cmake/finish_package.cmake)
include(CPack)
